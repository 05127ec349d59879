"""Searches whose answers are known, interrupted and resumed; what users do wrong."""

from __future__ import annotations

import ast
import inspect
import json
import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cosim import System
from cosim.study import Case, Experiment, FmuSet, Measures, Wiring, option
from cosim.study.optimise import CaseRuns, OptimisationError, optimise

SPACE = {"x": (-2.0, 2.0), "y": (-1.0, 1.0)}
TWO = {"a": "min", "b": "min"}


def circles(values: Mapping[str, Any]) -> dict[str, float]:
    """Distances from (0, 0) and (1, 0), squared: the front is the line between them."""
    x, y = values["x"], values["y"]
    return {"a": x * x + y * y, "b": (x - 1) ** 2 + y * y, "unused": 3.0}


def test_one_objective_finds_the_minimum_and_two_the_front(raises) -> None:
    one = optimise(circles, SPACE, {"a": "min"}, trials=48, seed=1)
    assert one.best.row["a"] < 0.05
    two = optimise(circles, SPACE, TWO, trials=64, seed=1)
    chance = optimise(circles, SPACE, TWO, trials=8, seed=1)
    assert len(two.front) > len(chance.front)
    for t in two.front:
        assert t.row["unused"] == 3.0
        assert not any(o.row["a"] < t.row["a"] and o.row["b"] < t.row["b"] for o in two.trials)
    assert [t.row["a"] for t in two.front] == sorted(t.row["a"] for t in two.front)
    with raises(OptimisationError):
        _ = two.best


def test_large_is_good_where_that_is_said() -> None:
    found = optimise(lambda v: {"a": -abs(v["x"] - 1.5)}, {"x": (-2.0, 2.0)}, {"a": "max"}, trials=32)
    assert abs(found.best.values["x"] - 1.5) < 0.2


def test_whole_numbers_logarithms_and_choices() -> None:
    space = {"n": (1, 4), "k": (1e-3, 1e3, "log"), "kind": ["red", "blue"]}
    found = optimise(lambda v: {"a": float(v["n"])}, space, {"a": "min"}, trials=24)
    assert {t.values["n"] for t in found.trials} <= {1, 2, 3, 4}
    assert {t.values["kind"] for t in found.trials} == {"red", "blue"}
    tried = [t.values["k"] for t in found.trials]
    assert min(tried) < 0.1
    assert max(tried) > 10


def test_an_interrupted_search_comes_to_the_trials_of_one_that_was_not(tmp_path: Path) -> None:
    whole = optimise(circles, SPACE, TWO, trials=24, seed=5)
    calls = 0

    def interrupted(values: Mapping[str, Any]) -> dict[str, float]:
        nonlocal calls
        calls += 1
        if calls in (4, 11):
            raise KeyboardInterrupt
        return circles(values)

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            optimise(interrupted, SPACE, TWO, trials=24, seed=5, storage=tmp_path / "kept" / "search.log")
    again = optimise(interrupted, SPACE, TWO, trials=24, seed=5, storage=tmp_path / "kept" / "search.log")
    assert again == whole
    assert calls == 24 + 2  # nothing that was finished is done again
    assert optimise(interrupted, SPACE, TWO, trials=24, seed=5, storage=tmp_path / "kept" / "search.log") == whole
    assert calls == 24 + 2
    longer = optimise(circles, SPACE, TWO, trials=40, seed=5, storage=tmp_path / "kept" / "search.log")
    assert longer == optimise(circles, SPACE, TWO, trials=40, seed=5)


def test_a_line_that_a_killed_process_left_is_taken_away(tmp_path: Path) -> None:
    file = tmp_path / "search.log"
    optimise(circles, SPACE, TWO, trials=8, storage=file)
    with file.open("ab") as f:
        f.write(b'{"op_code": 5, "trial')
    assert optimise(circles, SPACE, TWO, trials=16, storage=file) == optimise(circles, SPACE, TWO, trials=16)


def test_an_executor_gives_the_same_trials() -> None:
    with ThreadPoolExecutor(3) as pool:
        assert optimise(circles, SPACE, TWO, trials=16, executor=pool) == optimise(circles, SPACE, TWO, trials=16)
    assert optimise(circles, SPACE, TWO, trials=16, seed=1) != optimise(circles, SPACE, TWO, trials=16)


def test_what_is_published_is_tried_first() -> None:
    found = optimise(circles, SPACE, TWO, trials=10, first=[{"x": 0.5, "y": 0.25}, {"x": 0.0, "y": 0.0}])
    assert [dict(t.values) for t in found.trials[:2]] == [{"x": 0.5, "y": 0.25}, {"x": 0.0, "y": 0.0}]
    assert found.trials[0].row["a"] == 0.3125


def test_failures_are_kept_with_their_message_and_do_not_end_the_search(raises) -> None:
    def partly(values: Mapping[str, Any]) -> dict[str, float]:
        if values["x"] > 0:
            raise ValueError("too far")
        return {"a": float("nan")} if values["x"] > -1 else {"a": values["x"]}

    found = optimise(partly, {"x": (-2.0, 2.0)}, {"a": "min"}, trials=24)
    assert {t.failed for t in found.trials} == {"", "ValueError: too far", "a is nan"}
    assert found.best.values["x"] < -1
    calls: list[Any] = []
    with raises(OptimisationError):
        optimise(lambda v: calls.append(v) or {"b": 1.0}, {"x": (-2.0, 2.0)}, {"a": "min"}, trials=30)  # type: ignore[func-returns-value]
    assert len(calls) == 8  # one batch: it will not come later
    nothing = optimise(lambda v: {"a": math.nan}, {"x": (-2.0, 2.0)}, {"a": "min"}, trials=3)
    with raises(OptimisationError):
        _ = nothing.front


def test_a_file_of_another_model_is_refused(tmp_path: Path, raises) -> None:
    """Of a function only its author knows what it depends on."""
    file = tmp_path / "search.log"
    first = optimise(circles, SPACE, TWO, trials=2, storage=file, identity="mass 1")
    assert optimise(circles, SPACE, TWO, trials=2, storage=file, identity="mass 1") == first
    with raises(OptimisationError):
        optimise(circles, SPACE, TWO, trials=2, storage=file, identity="mass 2")


# ----------------------------------------------------------------------------------------------------- of an experiment


@dataclass(frozen=True)
class Drop(Case):
    height: float = option(1.0, unit="m", within=(0.1, 3.0), help="height", always=True)
    kind: str = option("soft", choices=("soft", "hard"), help="kind")


def wire(_: FmuSet, case: Drop) -> System:
    if case.height > 2:
        raise ValueError("it broke")
    return System()


EXPERIMENT = Experiment("drop", Drop, Wiring(wire), Measures(lambda run: {}))


def test_cases_of_an_experiment_need_its_fields_and_a_bad_one_fails(tmp_path: Path, raises) -> None:
    runs = CaseRuns(EXPERIMENT, FmuSet(), Drop(), tmp_path, processes=1)
    with raises(OptimisationError):
        optimise(runs, {"heigth": (0.1, 1.0)}, {"a": "min"}, trials=1)
    assert [str(r["failed"])[:15] for r in runs.evaluate_batch([{"height": 5.0}])] == ["height is 5 m; "]


# -------------------------------------------------------------------------------------------------- what users do wrong


@pytest.mark.parametrize(
    "changes",
    [
        {"space": {"x": (2.0, -2.0)}},
        {"space": {"x": (0.0, 1.0, "log")}},
        {"space": {"x": (0.0, 1.0, "lin")}},
        {"space": {"x": (0.0, float("inf"))}},
        {"space": {"x": 3}},
        {"space": {"x": "soft"}},
        {"space": {}},
        {"objectives": {}},
        {"objectives": {"a": "smaller"}},
        {"trials": 0},
        {"batch": 0},
        {"first": [{"x": 1.0}]},
    ],
)
def test_searches_that_cannot_be_made(changes: dict[str, Any], raises) -> None:
    given: dict[str, Any] = {"space": SPACE, "objectives": TWO, "trials": 4, **changes}
    with raises(OptimisationError):
        optimise(circles, given.pop("space"), given.pop("objectives"), **given)


def test_another_search_in_the_same_file(tmp_path: Path, raises) -> None:
    file = tmp_path / "search.log"
    optimise(circles, SPACE, TWO, trials=2, storage=file)
    for changes in ({"space": {"x": (-2.0, 3.0), "y": (-1.0, 1.0)}}, {"objectives": {"a": "min", "b": "max"}}):
        given: dict[str, Any] = {"space": SPACE, "objectives": TWO, **changes}
        with raises(OptimisationError):
            optimise(circles, given["space"], given["objectives"], trials=2, storage=file)
    with raises(OptimisationError):
        optimise(circles, SPACE, TWO, trials=2, storage=file, seed=4)
    optimise(circles, SPACE, TWO, trials=2, storage=file, seed=4, name="other")
    (tmp_path / "rubbish.log").write_text("no log\n\n")
    with raises(OptimisationError):
        optimise(circles, SPACE, TWO, trials=2, storage=tmp_path / "rubbish.log")


def test_optuna_is_used_by_its_public_names_only() -> None:
    """Its private ones may change with any release that the extra allows."""
    tree = ast.parse(Path(inspect.getfile(optimise)).read_text(encoding="utf-8"))
    private = {
        ast.unparse(n)
        for n in ast.walk(tree)
        if isinstance(n, ast.Attribute) and n.attr.startswith("_") and not n.attr.endswith("__")
    }
    assert {n for n in private if not n.startswith(("self.", "cls."))} == set()
    imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
    assert not any(part.startswith("_") for module in imported for part in module.split(".") if module != "__future__")


def test_a_storage_of_an_earlier_version_is_continued(tmp_path: Path) -> None:
    """It had the numbers of a trial as attributes of the trial."""
    storage = tmp_path / "trials.log"
    found = optimise(circles, SPACE, {"a": "min"}, trials=8, batch=4, storage=storage)
    lines = [json.loads(line) for line in storage.read_text().splitlines()]
    for line in lines:  # 2 sets an attribute of a study, 8 of a trial
        if line["op_code"] == 2 and (name := next(iter(line["user_attr"]))).startswith("trial "):
            line.update(op_code=8, trial_id=int(name.split()[1]), user_attr=line["user_attr"][name])
    assert any(line["op_code"] == 8 for line in lines)
    storage.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert optimise(circles, SPACE, {"a": "min"}, trials=8, batch=4, storage=storage).trials == found.trials
