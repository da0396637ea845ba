import logging

import pytest

from tdcr_planner.errors import InputError, UnknownNameError
from tdcr_planner.registry import Registry


def passed(name, found):
    return found


def check_number(name, found):
    if not isinstance(found, float):
        raise InputError(f"constant {name!r}", "a number", repr(found))
    return found


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Returns a function that leaves a package's entry points on the path as pip does."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(package, *entries):
        info = tmp_path / f"{package}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[tdcr_test.constants]\n" + "\n".join(entries) + "\n")

    return write


def make(check=passed):
    return Registry("constant", built_in={"pi": "math:pi", "tau": "math:tau"}, check=check, group="tdcr_test.constants")


def test_finds_what_is_built_in_and_what_packages_add(install):
    install("numbers_a", "e = math:e")
    registry = make()
    assert registry.names() == ("pi", "tau", "e")
    assert registry.find("pi") == pytest.approx(3.14159, abs=1e-5)
    assert registry.find("e") == pytest.approx(2.71828, abs=1e-5)
    assert [name for name, _ in registry.usable()] == ["pi", "tau", "e"]


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UnknownNameError, match=r"constant: got 'taw'; did you mean 'tau'\? valid: pi, tau"):
        make().find("taw")


def test_a_taken_name_is_left_out_with_one_warning_that_names_the_packages(install, caplog):
    install("numbers_a", "pi = math:e", "inf = math:inf")
    install("numbers_b", "inf = math:nan")
    registry = make()
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            assert registry.find("pi") == pytest.approx(3.14159, abs=1e-5)
            assert registry.find("inf") == float("inf")
    messages = [record.getMessage() for record in caplog.records]
    assert messages == [
        "package numbers_b registers a constant 'inf', a name that package numbers_a has: left out",
        "package numbers_a registers a constant 'pi', a name that tdcr_planner has: left out",
    ]


@pytest.mark.parametrize(
    ("target", "reason"), [("no_such_module:x", "No module named"), ("math:x", "no attribute 'x'")]
)
def test_what_cannot_be_imported_is_an_error_where_it_is_named_and_left_out_elsewhere(install, caplog, target, reason):
    install("numbers_a", f"broken = {target}")
    registry = make()
    with pytest.raises(InputError, match=f"constant 'broken': expected package numbers_a .*{reason}"):
        registry.find("broken")
    assert registry.find("tau") == pytest.approx(6.28318, abs=1e-5)
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            assert [name for name, _ in registry.usable()] == ["pi", "tau"]
    assert len(caplog.records) == 1
    assert "numbers_a" in caplog.text


def test_what_is_of_another_kind_is_refused(install):
    install("numbers_a", "sine = math:sin")
    with pytest.raises(InputError, match="constant 'sine': expected a number"):
        make(check_number).find("sine")
