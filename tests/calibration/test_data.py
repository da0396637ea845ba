"""Measured states: what is read, and that what cannot have been measured is named with line and column."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_planner.calibration import checks
from tdcr_planner.calibration.data import read_measured_states
from tdcr_planner.errors import FormatError


def table(path, **columns):
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def columns(count=12, tendons=6):
    ramp = np.linspace(0.0, 1.0, count)
    found = {"time_s": 100.0 + ramp}
    found |= {f"tendon_displacement_{index + 1}_m": 0.002 * ramp for index in range(tendons)}
    return found | {"tip_x_m": 0.05 * ramp, "tip_y_m": 0.0 * ramp, "tip_z_m": 0.1 + 0.0 * ramp}


def test_reads_states_in_their_order(tmp_path, robot):
    states = read_measured_states(table(tmp_path / "a.csv", **columns()), robot)
    assert len(states) == 12
    np.testing.assert_allclose(states.times[[0, -1]], [0.0, 1.0])
    np.testing.assert_allclose(states.displacements[-1], 0.002)
    assert states.point_names() == ["disk -1"]
    assert np.isnan(states.tensions).all()


def test_counts_from_zero_when_there_is_a_zero(tmp_path, robot):
    shifted = {}
    for name, values in columns().items():
        parts = name.split("_")
        shifted["_".join([*parts[:2], str(int(parts[2]) - 1), "m"]) if name.startswith("tendon") else name] = values
    shifted["tendon_displacement_0_m"] = 0.5 * shifted["tendon_displacement_0_m"]
    states = read_measured_states(table(tmp_path / "a.csv", **shifted), robot)
    np.testing.assert_allclose(states.displacements[-1, :2], [0.001, 0.002])


def edited(**changes):
    found = columns()
    for name, value in changes.items():
        if value is None:
            del found[name]
        else:
            found[name] = value(found.get(name, np.zeros(12)))
    return found


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tendon_displacement_3_m": None}, r"missing columns: tendon_displacement_3_m: robot 'small bench' has 6"),
        ({"tip_y_m": None}, "missing columns: tip_y_m"),
        ({"tendon_displacement_7_m": np.zeros_like}, r"tendon_displacement_7_m: robot 'small bench' has 6 tendons"),
        ({"tip_X_m": np.zeros_like}, "tip_X_m: unknown column; did you mean 'tip_x_m'"),
        ({"disk_9_x_m": np.zeros_like}, "disk_9_x_m: expected disks 1 to 6"),
        (
            {"tendon_displacement_2_m": lambda values: 1e3 * values},
            r"line 3, tendon_displacement_2_m: expected less than the 0.06 m .* got 0.181818; is it in mm\?",
        ),
        (
            {"tip_x_m": lambda values: 1e3 * values},
            r"line 3: a point is 4.5.* from the base, and the robot reaches 0.186 m; is the unit metre",
        ),
        (
            {"tip_x_m": lambda values: 1e-5 * values, "tip_z_m": lambda values: 1e-3 * values},
            r"all points move within 5e-07 m, on a robot of 0.12 m; is the unit metre\?",
        ),
        ({"time_s": lambda values: values[::-1]}, "line 3, time_s: expected a time after that of the row before"),
        ({"gravity_x_m_s2": np.ones_like}, "missing columns: gravity_y_m_s2, gravity_z_m_s2"),
        ({"roll_deg": lambda values: np.arange(12.0)}, "line 3, roll_deg: expected the same as in the first row, 0"),
    ],
)
def test_what_cannot_have_been_measured_is_named(tmp_path, robot, changes, message):
    with pytest.raises(FormatError, match=message):
        read_measured_states(table(tmp_path / "a.csv", **edited(**changes)), robot)


def test_the_drive_says_which_columns_are_needed(tmp_path, robot, make_robot):
    path = table(tmp_path / "a.csv", **columns())
    with pytest.raises(FormatError, match=r"missing columns: tension_1_n to tension_6_n.*kind = 'tension'"):
        read_measured_states(path, make_robot("tension"))


def test_tensions_of_another_robot_are_refused(tmp_path, make_robot):
    found = columns()
    tensions = {f"tension_{index + 1}_n": 40.0 * index * np.linspace(0.0, 1.0, 12) for index in range(6)}
    kept = {name: values for name, values in found.items() if not name.startswith("tendon")}
    with pytest.raises(FormatError, match=r"line 6, tension_6_n: expected 0 to 30 N, got 72.7273; is the unit newton"):
        read_measured_states(table(tmp_path / "a.csv", **kept, **tensions), make_robot("tension"))


def test_another_frame_is_no_fault_where_the_base_is_fitted(tmp_path, robot):
    moved = edited(tip_z_m=lambda values: values + 1.0)
    path = table(tmp_path / "a.csv", **moved)
    with pytest.raises(FormatError, match="else fit the base, too"):
        read_measured_states(path, robot)
    assert len(read_measured_states(path, robot, base_is_known=False)) == 12


def test_a_long_gap_in_time_is_named(tmp_path, robot):
    late = edited(time_s=lambda values: values + 60.0 * (np.arange(12) >= 7))
    states = read_measured_states(table(tmp_path / "a.csv", **late), robot)
    with pytest.raises(FormatError, match=r"line 9, time_s: no state for 60.09 s before this one, expected at most"):
        checks.check_gaps(states.table, states.times)
