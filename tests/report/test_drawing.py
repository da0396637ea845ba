import logging

import pytest

from tdcr_planner.report.drawing import draw_pictures


def test_a_picture_that_fails_is_one_warning_and_costs_no_other(tmp_path, caplog):
    def fail(file):
        file.write_text("half")
        raise ValueError("no\nsuch colour")

    drawings = {"a.png": lambda file: file.write_text("a"), "b.png": fail, "c.png": lambda file: file.write_text("c")}
    with caplog.at_level(logging.WARNING):
        assert draw_pictures(tmp_path, drawings) == ["a.png", "c.png"]
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / 'b.png'} is not drawn: ValueError: no such colour"
    ]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.png", "c.png"]


def test_a_picture_of_an_earlier_result_does_not_stay_beside_a_new_one(tmp_path):
    for name in ("a.png", "old.png", "kept.txt"):
        (tmp_path / name).write_text("earlier")

    def fail(file):
        raise OSError("disk full")

    assert draw_pictures(tmp_path, {"a.png": fail}, stale=("old.png",)) == []
    assert [file.name for file in tmp_path.iterdir()] == ["kept.txt"]


def test_what_is_no_plain_file_is_left_alone(tmp_path, caplog):
    (tmp_path / "a.png").mkdir()
    (tmp_path / "a.png" / "inside").write_text("kept")
    assert draw_pictures(tmp_path, {"a.png": lambda file: file.write_text("a")}) == []
    assert (tmp_path / "a.png" / "inside").read_text(encoding="utf-8") == "kept"
    assert "a.png is not drawn" in caplog.text


def test_an_interrupt_stays_one(tmp_path):
    def stop(file):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        draw_pictures(tmp_path, {"a.png": stop})
