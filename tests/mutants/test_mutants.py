"""The mistakes that `make mutants` makes, and how it finds those that no test notices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mutants import __main__ as command
from mutants.groups import GROUPS, ROOT, Group
from mutants.mutations import Mutant, mutants, mutated, sample

SOURCE = '''
"""Three kinds of numbers."""
import math

FACTOR = 3.6

def speeds(run, names):
    """Speeds."""
    if len(run) < 2 and not names:
        raise ValueError(f"{1 + 1} samples")
    first = run["x"][1:]
    return [1e3 * max(run["y"][-1], 0.5), plot("time [s]", first), math.sqrt(first[0] - run[f"car.{names}.z"] ** 2)]

def wheel(run, k):
    return run[f"wheel.{k}"] if k else {"a": run["x"], "b": run["y"]}
'''


def changes(kind: str) -> set[tuple[str, str]]:
    return {(m.before, m.after) for m in mutants("a.py", SOURCE) if m.kind == kind}


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (
            "number",
            {
                ("FACTOR = 3.6", "FACTOR = 1"),
                ("run[f'car.{names}.z'] ** 2", "run[f'car.{names}.z'] ** 4"),
                ("1000.0 * max(run['y'][-1], 0.5)", "100.0 * max(run['y'][-1], 0.5)"),
            },
        ),
        ("name", {("'x'", "'y'"), ("'y'", "'x'")}),
        ("slice", {("run['x'][1:]", "run['x'][2:]"), ("run['y'][-1]", "run['y'][-2]"), ("first[0]", "first[1]")}),
        ("comparison", {("len(run) < 2", "len(run) > 2")}),
        (
            "condition",
            {
                ("len(run) < 2 and (not names)", "len(run) < 2 or not names"),
                ("not names", "names"),
                (
                    "run[f'wheel.{k}'] if k else {'a': run['x'], 'b': run['y']}",
                    "{'a': run['x'], 'b': run['y']} if k else run[f'wheel.{k}']",
                ),
            },
        ),
        ("times", {("1000.0 * max(run['y'][-1], 0.5)", "1000.0 / max(run['y'][-1], 0.5)")}),
        ("sign", {("first[0] - run[f'car.{names}.z'] ** 2", "first[0] + run[f'car.{names}.z'] ** 2")}),
        (
            "function",
            {
                ("max(run['y'][-1], 0.5)", "min(run['y'][-1], 0.5)"),
                ("math.sqrt(first[0] - run[f'car.{names}.z'] ** 2)", "first[0] - run[f'car.{names}.z'] ** 2"),
            },
        ),
        ("arguments", {("plot: 'time [s]', first", "plot: first, 'time [s]'")}),
    ],
)
def test_mistakes_of_a_kind(kind: str, expected: set[tuple[str, str]]) -> None:
    """What is raised and what stands in comments is no place for one."""
    assert changes(kind) == expected


def test_columns_that_are_swapped() -> None:
    assert len(changes("items")) == 3  # two of the list, one of the dictionary
    assert ("run['x'], run['y']", "run['y'], run['x']") in changes("items")


def test_a_name_made_of_names_becomes_one_of_the_same_parts() -> None:
    source = "def f(r, k, n):\n    return r[f'car.{k}.z'] + r[f'car.{n}.z'] + r[f'tire.{k}.z']\n"
    found = {(m.before, m.after) for m in mutants("a.py", source) if m.kind == "name"}
    assert found == {("f'tire.{k}.z'", "f'car.{k}.z'")}


@pytest.mark.parametrize("file", ["cosim/report/plots.py", "cosim/experiments/preview_lq/runs.py"])
def test_every_mistake_is_another_program_in_one_place(file: str) -> None:
    source = (ROOT / file).read_text(encoding="utf-8")
    found = mutants(file, source)
    assert len({m.id for m in found}) == len(found)
    chosen = sample(found, 1)
    texts = {mutated(m, source) for m in chosen}
    assert len(texts) == len(chosen)
    for text in texts:
        compile(text, file, "exec")


def test_a_mistake_is_made_where_its_name_says() -> None:
    second = next(m for m in mutants("a.py", SOURCE) if m.where == "wheel" and m.kind == "items")
    text = mutated(second, SOURCE)
    assert "{'a': run['y'], 'b': run['x']}" in text
    assert "FACTOR = 3.6" in text
    with pytest.raises(LookupError, match=r"wheel \| items"):
        mutated(second, "FACTOR = 3.6")


def test_the_sample_is_the_same_whatever_else_is_written() -> None:
    """A function more in the file, and those that were chosen are chosen again unless new ones come before them."""
    found = mutants("a.py", SOURCE)
    assert sample(found, 2) == sample(list(reversed(found)), 2)[::-1]
    assert {m for m in found if m.kind == "times"} <= set(sample(found, 1))
    assert max(sum(m.kind == k for m in sample(found, 2)) for k in {m.kind for m in found}) == 2
    more = mutants("a.py", SOURCE + "def more(x):\n    return 2 * x\n")
    assert set(sample(found, 99)) < set(sample(more, 99))


def test_rooms_have_files_tests_and_nothing_accepted_that_cannot_be_made() -> None:
    known = set()
    for group in GROUPS:
        assert group.files(), group.name
        assert group.test_files(), group.name
        assert len(group.slower_files()) >= len(group.slower), group.name
        known |= {m.id for m in command.of_group(group)}
    for name, reason in command.accepted().items():
        assert name in known, f"accepted.txt: there is no such mistake any more: {name}"
        assert len(reason) > 10, f"accepted.txt: no reason below {name}"


PLUS = "def plus(a, b):\n    return a + b\n\n\ndef unseen(a):\n    return 2 * a\n"
TEST = "from cosim.plus import plus\n\n\ndef test_plus():\n    assert plus(1, 2) == 3\n"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small project with one function that is tested and one that is not."""
    for name in ("build_fmus", "cosim", "docs", "fmu_sources", "fmus", "tests"):
        (tmp_path / name).mkdir()
    for name in ("README.md", "pyproject.toml", "cosim/__init__.py"):
        (tmp_path / name).write_text("")
    (tmp_path / "tests" / "built.py").write_text("class BuiltFmus: ...\n")
    (tmp_path / "cosim" / "plus.py").write_text(PLUS)
    (tmp_path / "tests" / "test_plus.py").write_text(TEST)
    monkeypatch.setattr(command, "ROOT", tmp_path)
    monkeypatch.setattr(command, "STORE", tmp_path / "store")
    monkeypatch.setattr(command, "ACCEPTED", tmp_path / "accepted.txt")
    monkeypatch.setattr("mutants.groups.ROOT", tmp_path)
    monkeypatch.setattr(command, "GROUPS", (Group("plus", ("cosim/plus.py",), ("tests/test_plus.py",)),))
    monkeypatch.setattr("sys.argv", ["mutants"])
    (tmp_path / "accepted.txt").write_text("# none\n")
    return tmp_path


def test_what_no_test_notices_is_listed(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [
        Mutant("cosim/plus.py", "unseen", "number", "2 * a", "4 * a", 1).id,
        Mutant("cosim/plus.py", "unseen", "times", "2 * a", "2 / a", 1).id,
    ]
    assert command.main() == 1
    assert capsys.readouterr().out.splitlines()[-3:] == [
        names[1],
        names[0],
        "3 mistakes, 1 noticed, 0 accepted, 2 not noticed",
    ]
    assert (project / "cosim" / "plus.py").read_text() == PLUS
    (project / "accepted.txt").write_text(
        f"# comment\n{names[0]}\n    no test calls it,\n    yet\n{names[1]}\n  nor this\n"
    )
    assert command.accepted() == {names[0]: "no test calls it, yet", names[1]: "nor this"}
    (project / "tests" / "built.py").write_text("")  # what was tried is kept, and not tried again
    assert command.main() == 0
    assert "3 mistakes, 1 noticed, 2 accepted, 0 not noticed" in capsys.readouterr().out


def test_what_is_written_to_the_project_meanwhile_is_not_seen(
    project: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a mutation could be applied to a function that is gone.

    Or it could be tried beside other code than it was made for.
    """
    groups = tuple(Group(name, ("cosim/plus.py",), ("tests/test_plus.py",)) for name in ("first", "second"))
    monkeypatch.setattr(command, "GROUPS", groups)
    copied_tree, imported = command.trial.copied_tree, command.trial.imported

    def change(*arguments: Any) -> list[Path]:
        (project / "cosim" / "plus.py").write_text("def minus(a, b):\n    return a - b\n")
        (project / "tests" / "test_plus.py").unlink(missing_ok=True)
        return imported(*arguments)

    monkeypatch.setattr(command.trial, "imported", change)
    monkeypatch.setattr("sys.argv", ["mutants", "--processes", "2"])
    assert command.main() == 1
    assert capsys.readouterr().out.splitlines()[-1] == "6 mistakes, 2 noticed, 0 accepted, 4 not noticed"
    with copied_tree(project) as tree:  # and another command sees it
        assert [m.where for m in command.of_group(groups[0], tree)] == ["minus"]


def test_what_a_tree_imports_is_that_of_the_tree() -> None:
    with command.trial.copied_tree(ROOT) as tree:
        (tree / "cosim" / "core" / "signals.py").write_text("from cosim.core import time\n")
        found = command.trial.imported(tree, ["cosim/core/signals.py"])
    assert {p.relative_to(tree).as_posix() for p in found if p.suffix == ".py"} > {
        "cosim/core/signals.py",
        "cosim/core/time.py",
    }
    assert all(p.is_relative_to(tree) for p in found)


def test_tests_of_the_project_run_in_a_copy_of_it() -> None:
    with command.trial.copied_tree(ROOT) as tree:
        assert command.trial.passes(tree, ["tests/cosim_metrics/test_metrics.py"])


def test_bytecode_is_that_of_the_project_and_never_of_a_mistake(project: Path) -> None:
    """Two mistakes of the same length in a file whose time is the same would be one."""
    tests = ["tests/test_plus.py"]
    with command.trial.copied_tree(project) as tree, command.trial.copied_tree(tree) as other:
        assert command.trial.baseline(tree, tests).passed
        command.trial.copy_bytecode(tree, [other])
        for place in (tree, other):
            (kept,) = place.glob("cosim/__pycache__/plus.*.pyc")
            before = kept.read_bytes()
            for text, passed in (("a - b", False), ("b + a", True), ("b - a", False)):
                with command.trial.changed(place / "cosim" / "plus.py", PLUS.replace("a + b", text)):
                    assert command.trial.passes(place, tests) == passed
            assert kept.read_bytes() == before
            assert [p.name for p in place.glob("cosim/__pycache__/plus.*")] == [kept.name]


def test_tests_that_fail_without_any_mistake_are_told(project: Path, raises) -> None:
    (project / "tests" / "test_plus.py").write_text(TEST.replace("3", "4"))
    with raises(SystemExit):
        command.main()


def test_slower_tests_are_tried_on_what_the_others_did_not_notice(
    project: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (project / "tests" / "test_slow.py").write_text(
        "from cosim.plus import plus, unseen\n\n\ndef test_all():\n    assert plus(1, 2) == 3\n    assert unseen(3)"
        " == 6\n"
    )
    group = Group("plus", ("cosim/plus.py",), ("tests/test_plus.py",), slower=("tests/test_slow.py",))
    monkeypatch.setattr(command, "GROUPS", (group,))
    assert command.main() == 0
    assert "3 mistakes, 3 noticed, 0 accepted, 0 not noticed" in capsys.readouterr().out


def test_a_test_that_never_ends_has_noticed(
    project: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command.trial, "LIMIT", (3.0, 0.0))
    monkeypatch.setattr("sys.argv", ["mutants", "--only", "| plus |"])
    (project / "tests" / "test_plus.py").write_text(
        "from cosim.plus import plus\n\n\ndef test_plus():\n    while plus(1, 2) != 3:\n        pass\n"
    )
    command.main()
    assert "1 mistakes, 1 noticed" in capsys.readouterr().out
