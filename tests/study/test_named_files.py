"""Files that a case names, and those made of a user's own: other contents are other runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cosim.study import Case, Experiment, FmuSet, Measures, Wiring, key, option
from cosim.study.runner import entry_key


@dataclass(frozen=True)
class Ride(Case):
    weights: str = option("soft", choices=("soft", "hard"), files=".toml", help="weights")
    note: str = option("", help="a text that names no file")


def test_the_key_of_a_run_has_the_contents_of_the_files_that_its_case_names(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    keys = [entry_key(Ride(str(file)))]
    for text in ("heave = 3", "heave = 4"):
        file.write_text(text)
        keys.append(entry_key(Ride(str(file))))
        assert entry_key(Ride(str(file), note=str(file))) != keys[-1]  # another case
    assert len({str(k) for k in keys}) == 3
    file.write_text("heave = 3")
    assert entry_key(Ride(str(file))) == keys[1]
    assert entry_key(Ride("hard", note=str(file))) == ["metrics", {"weights": "hard", "note": str(file)}]


def test_the_key_of_a_study_has_the_fmus_of_a_users_files(tmp_path: Path) -> None:
    """Also those that the experiment does not name, such as the law of a user's weights."""
    experiment = Experiment("ride", Ride, Wiring(option), Measures(option))
    fmus = FmuSet(tmp_path, own={"LawMine": ("LawMineMyCar", "--weights mine.toml"), "Road": ("RoadMyCar", "")})
    assert fmus.own_paths == []
    keys = [key.salt(experiment, fmus)]
    law = tmp_path / "fmi3" / "LawMineMyCar.fmu"
    law.parent.mkdir()
    for content in (b"1", b"2"):
        law.write_bytes(content)
        assert fmus.own_paths == [law]
        keys.append(key.salt(experiment, fmus))
    assert len(set(keys)) == 3
