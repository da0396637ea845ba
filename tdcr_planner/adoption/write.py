"""Writing an adopted network: card and network in one archive, the same bytes for the same content."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from tdcr_planner.errors import FormatError
from tdcr_planner.outputs import write_file_whole
from tdcr_planner.shape.card import ModelCard
from tdcr_planner.shape.foreign_network import MODULE_FILES
from tdcr_planner.shape.model_file import CARD_FILE

_FOLDER = "model"


def write_adopted(path: Path, card: ModelCard, network: bytes) -> None:
    """Writes a model file of an adopted network, whole or not at all.

    Args:
        path: The file.
        card: Its card, whose `adoption` says what the network is.
        network: The network's checked bytes.

    Raises:
        FormatError: It cannot be written.
    """
    assert card.adoption is not None  # an adopted network's card has it
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, content in (
            (CARD_FILE, card.model_dump_json(indent=1).encode()),
            (MODULE_FILES[card.adoption.kind], network),
        ):
            archive.writestr(zipfile.ZipInfo(f"{_FOLDER}/extra/{name}"), content)
    try:
        with write_file_whole(path) as temporary:
            temporary.write_bytes(buffer.getvalue())
    except OSError as error:
        raise FormatError(path, f"cannot be written: {error.strerror or error}") from error
