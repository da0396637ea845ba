"""Values as JSON has them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np


def plain_json(value: Any) -> Any:
    """Returns a value as JSON has it: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, np.generic):
        return plain_json(value.item())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
