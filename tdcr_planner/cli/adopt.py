"""tdcr adopt: a shape model from somebody's TorchScript or ONNX network."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from tdcr_planner.adoption.discovery import Given
    from tdcr_planner.learning.settings import DomainSettings
    from tdcr_planner.robot import RobotSpec


@dataclass(frozen=True)
class ConventionOptions:
    """What is known of the network's convention; the rest is found.

    Attributes:
        inputs: What it takes, in order, with commas: tensions, bending, gravity, tip_force, arc_length (a row a disk).
        outputs: What it gives, in order, with commas: positions, rotations, poses, quaternions_wxyz, quaternions_xyzw,
            rotations_6d, rotation_vectors, ignored.
        length_unit: Unit of positions and arc lengths.
        force_unit: Unit of tensions, bending vectors and tip force.
        tendon_order: For each of its tendons the robot's, counted from 1, as in 2,3,1.
        base_turn_deg: Turn of the robot's base frame about z as the network's frame has it, in degrees.
        transposed: Its rotations are disk_from_base.
        disk_order: Order of the disks in its answer.
    """

    inputs: str | None = None
    outputs: str | None = None
    length_unit: Literal["m", "cm", "mm"] = "m"
    force_unit: Literal["N", "mN"] = "N"
    tendon_order: str | None = None
    base_turn_deg: float = 0.0
    transposed: bool = False
    disk_order: Literal["base_to_tip", "tip_to_base"] = "base_to_tip"

    def given(self, robot: RobotSpec) -> Given:
        """Returns what the options say."""
        from tdcr_planner.adoption.discovery import Given, check_names

        half = math.radians(self.base_turn_deg) / 2.0
        others: dict[str, Any] = {
            "length_unit": self.length_unit,
            "force_unit": self.force_unit,
            "transposed": self.transposed,
            "disk_order": self.disk_order,
            "base_quaternion_wxyz": (math.cos(half), 0.0, 0.0, math.sin(half)),
        }
        if self.tendon_order is not None:
            others["tendon_order"] = _check_order(self.tendon_order, robot.tendon_count)
        return Given(
            inputs=None if self.inputs is None else check_names("--inputs", self.inputs, "inputs"),
            outputs=None if self.outputs is None else check_names("--outputs", self.outputs, "outputs"),
            others=others,
        )


@dataclass(frozen=True)
class DomainOptions:
    """The inputs that the network shall answer for.

    Attributes:
        gravity_m_s2: Largest gravity of the domain; the Earth's if it takes gravity.
        tip_force_n: Largest tip force of the domain; one that moves the tip by a tenth of the length if it takes one.
        tension_share: Part of each tendon's limit up to which it shall answer.
    """

    gravity_m_s2: float | None = None
    tip_force_n: float | None = None
    tension_share: float = 1.0

    def settings(self) -> DomainSettings:
        """Returns the domain that the options say."""
        from tdcr_planner.errors import InputError
        from tdcr_planner.learning.settings import DomainSettings

        found: dict[str, Any] = {}
        for name, value, low, high in (
            ("tension_share", self.tension_share, 1e-3, 1.0),
            ("gravity_m_s2", self.gravity_m_s2, 0.0, 100.0),
            ("tip_force_n", self.tip_force_n, 0.0, 1e6),
        ):
            if value is None:
                continue
            if not low <= value <= high:
                raise InputError(f"--{name.replace('_', '-')}", f"a number from {low:g} to {high:g}", value)
            found[name] = value
        return DomainSettings(**found)


def adopt(
    module: tyro.conf.Positional[Path],
    *,
    robot: Path,
    out: Path,
    convention: Annotated[ConventionOptions, tyro.conf.arg(name="")] = ConventionOptions(),
    domain: Annotated[DomainOptions, tyro.conf.arg(name="")] = DomainOptions(),
    correct: bool = False,
    alpha: float = 0.001,
    cases: int = 8_000,
    seed: int = 0,
    progress: bool = True,
) -> int:
    """Make a shape model of somebody's TorchScript (.pt) or ONNX (.onnx) network, and judge it.

    Example: tdcr adopt mine.pt --robot models/robots/paper.toml --out mine_model.pt

    The file is checked before it is loaded: only what computes shapes is let through. What the network takes and gives
    is found by names and shapes, or said by the options. It is measured against the reference, its error bound is
    calibrated, and it is written with a card as `tdcr train` writes one; a picture beside it shows where in the domain
    the error lies. `plan`, `compare`, `sweep`, `evaluate`, `robustness` and `info` take the file.

    Exit code 0 says fit for planning with this robot, 1 that the model was written but is not fit, 2 that the network
    cannot be used: nothing is written.

    Args:
        module: The network's file.
        robot: Robot file.
        out: Model file to write.
        convention: What is known of its convention.
        domain: The inputs that it shall answer for.
        correct: Apply one Newton step by mechanics to its answers.
        alpha: Part of fresh cases that may exceed the error bound.
        cases: Calibration cases of each sample.
        seed: Seed of all cases.
        progress: Draw a progress bar; print a line now and then where standard error is no terminal.
    """
    from tdcr_planner.adoption.adopt import AdoptSettings
    from tdcr_planner.adoption.adopt import adopt as adopt_network
    from tdcr_planner.bounds import SEED
    from tdcr_planner.cli.cost import REFERENCE_S, tell_cost
    from tdcr_planner.cli.pictures import draw_after
    from tdcr_planner.cli.progress import StageBar
    from tdcr_planner.files import check_file_target
    from tdcr_planner.learning.fitness import judge_fitness
    from tdcr_planner.report.adoption_plot import draw_adoption
    from tdcr_planner.robot import load_robot
    from tdcr_planner.shape.learned import load_shape_model

    SEED.check("--seed", seed)
    check_file_target(out)
    spec = load_robot(robot)
    settings = AdoptSettings(
        given=convention.given(spec),
        domain=domain.settings(),
        correct=correct,
        alpha=alpha,
        cases=cases,
        seed=seed,
    )
    tell_cost("--cases", 2 * (cases + settings.judged) * REFERENCE_S, 0)
    with StageBar(shown=progress) as bar:
        adopted = adopt_network(module, spec, out, settings, progress=bar.update)
        fitness = judge_fitness(load_shape_model(out), seed=seed, progress=bar.update)
    print(adopted.card.describe())
    print(f"file: {out}", flush=True)
    picture = out.with_name(f"{out.stem}_error.png")

    def draw() -> list[str]:
        draw_adoption(adopted, picture)
        return [picture.name]

    if draw_after("the model", draw):
        print(f"picture: {picture}")
    print(adopted.describe_speed())
    print(fitness.describe())
    return 0 if fitness.fit else 1


def _check_order(given: str, count: int) -> tuple[int, ...]:
    from tdcr_planner.errors import InputError

    parts = [part.strip() for part in given.split(",")]
    if sorted(parts) != sorted(str(index) for index in range(1, count + 1)):
        raise InputError("--tendon-order", f"each of 1 to {count} once, with commas", given)
    return tuple(int(part) for part in parts)
