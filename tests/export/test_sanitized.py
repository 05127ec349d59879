"""Engine, container and linked components under AddressSanitizer, UndefinedBehaviorSanitizer and ThreadSanitizer.

Third-party FMUs run beside them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import fmpy
import pytest
from built import BuiltFmus
from foreign import calculating, eventful, following, pulses, sloped
from lxml import etree
from sanitized import FLAGS, THREADS, gcc, kept_object

from cosim import System

DRIVER = Path(__file__).with_name("driver.c")
STEP = "0.01"


@pytest.fixture(scope="module")
def unpacked(built_fmus: BuiltFmus, follower: dict[int, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sampled law on a plant, with a quadratic program, and FMUs of others of both versions, two in a loop."""
    folder = tmp_path_factory.mktemp("sanitized")
    with System() as system:
        system.add("plant", built_fmus.path("QuarterCarBench", 3))
        system.add("law", built_fmus.path("MpcBench", 2))
        system.add("late", follower[2], step="2 ms", start={"u": 30.0})
        system.add("later", follower[3], step="5 ms", offset="1 ms")
        system.connect_matching("plant", "law", "*")
        system.connect_matching("law", "plant", "*")
        system.connect("late.count", "later.count_in")
        system.connect("late.y", "later.u", delay=True)
        for name, fmi, trouble in (("at_once", 2, 0.0), ("in_steps", 3, 6.0)):  # a loop, of which one repeats its steps
            values = {"k": 0.5, "trouble": trouble}
            system.add(name, sloped.build(fmi, folder), step="10 ms", parameters=values)
        system.connect("at_once.a", "in_steps.p")
        system.connect("in_steps.a", "at_once.p")
        for name in ("ahead", "behind"):  # inputs that follow inside of steps, with an element that nobody drives
            system.add(name, following.build(folder), step="10 ms", start={"u": 1.0})
        for variable in ("w[1]", "w[2]"):
            system.connect("ahead.x", f"behind.{variable}", extrapolate=True)
        for fmi in (2, 3):  # calculated parameters
            system.add(f"calculated{fmi}", calculating.build(folder, fmi), step="10 ms")
        system.connect("calculated3.sums[2]", "calculated2.factor")
        system.connect("calculated2.next", "calculated3.n")
        system.add("calculated", calculating.build(folder, 3), step="10 ms", parameters={"name": "you", "key": b"ab"})
        for output, parameter in (("greeting", "name"), ("lock", "key"), ("larger", "large")):
            system.connect(f"calculated.{output}", f"calculated3.{parameter}")
        ticking = pulses.build(folder, early_return=True)  # connected clocks, and one that returns early again
        for name, period, relay in (("again", 0.0, 6), ("ticks", 0.0031, 3), ("told", 0.0, 1), ("other", 0.0041, 3)):
            system.add(name, ticking, step="10 ms", parameters={"period": period, "relay": relay})
        for source, target in (("ticks", "again"), ("ticks", "told"), ("other", "ticks")):
            system.connect(f"{source}.out", f"{target}.in")
        system.connect("ticks.y", "told.x")
        system.add("eventful", eventful.build(folder), step="10 ms", start={"u": 1.0, "k": 1})
        return Path(fmpy.extract(system.export_fmu(folder / "Sanitized.fmu", fmi=3), folder / "files"))


@pytest.mark.sanitizer
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc with its sanitizers")
@pytest.mark.parametrize(("sanitizers", "told"), [(FLAGS, ()), (THREADS, ("-DTHREADS",))], ids=["memory", "threads"])
def test_clean_under_sanitizers(unpacked, tmp_path, sanitizers, told):
    sources = unpacked / "sources"
    root = etree.parse(sources / "buildDescription.xml").getroot()
    names = [e.get("name") for e in root.find("BuildConfiguration").iter("SourceFile")]
    objects = [kept_object(sources / n, sources, sanitizers=sanitizers) for n in names]
    objects.append(kept_object(DRIVER, sources, *told, sanitizers=sanitizers))
    program = tmp_path / "driver"
    gcc(*sanitizers, *map(str, objects), "-lm", "-ldl", "-lpthread", "-o", str(program))
    environment = {
        **os.environ,
        "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1",
        "TSAN_OPTIONS": "exitcode=66",
    }
    run = subprocess.run(
        [str(program), STEP, str(unpacked / "resources")],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        timeout=300,
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]
    assert run.stderr == ""
