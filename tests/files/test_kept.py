"""What is kept to save work is used only as it was written."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from build_fmus.base import safe_files
from build_fmus.base.safe_files import CacheMiss, DamagedWarning

VALUE = {"J": 0.1, "rows": [1, 2.5, None, True], "name": "Längs"}


def test_a_kept_value_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    with pytest.raises(CacheMiss):
        safe_files.kept_json(path)
    for value in (VALUE, 3, None, [], {"tuple": (1, 2), 5: "number"}):
        safe_files.keep_json(path, value)
        assert safe_files.kept_json(path) == json.loads(json.dumps(value))


@pytest.mark.parametrize(
    ("old", "new"),
    [("0.1", "0.2"), ("2.5", "2.500001"), ("true", "false"), ('"J"', '"K"'), ("}", ""), ('{"sha', '{"shb')],
)
def test_a_changed_value_is_discarded_by_name(old: str, new: str, tmp_path: Path, warns) -> None:
    path = tmp_path / "a.json"
    safe_files.keep_json(path, VALUE)
    path.write_text(path.read_text().replace(old, new, 1))
    with warns(DamagedWarning, match=re.escape(f"{path}")), pytest.raises(CacheMiss):
        safe_files.kept_json(path)
    assert not path.exists()


def test_one_entry_is_not_taken_for_another(tmp_path: Path) -> None:
    safe_files.keep_json(tmp_path / "a.json", VALUE)
    (tmp_path / "a.json").rename(tmp_path / "b.json")
    with pytest.warns(DamagedWarning, match="b.json"), pytest.raises(CacheMiss):
        safe_files.kept_json(tmp_path / "b.json")
    file = safe_files.keep_file(tmp_path, "key", ".o", lambda out: out.write_bytes(b"object") and None)
    file.rename(tmp_path / file.name.replace("key", "other"))
    with pytest.warns(DamagedWarning, match="other-"), pytest.raises(CacheMiss):
        safe_files.kept_file(tmp_path, "other", ".o")


def test_every_flipped_bit_of_a_file_is_found(tmp_path: Path) -> None:
    content = b"an object"
    for bit in range(8 * len(content)):
        path = safe_files.keep_file(tmp_path, "key", ".o", lambda out: out.write_bytes(content) and None)
        assert safe_files.kept_file(tmp_path, "key", ".o") == path
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with pytest.warns(DamagedWarning, match=re.escape(str(path))), pytest.raises(CacheMiss):
            safe_files.kept_file(tmp_path, "key", ".o")


def test_files_that_another_process_keeps_or_removes(tmp_path: Path) -> None:
    """One that it keeps is found; one that it removed is missing, also where the folder's clock has not moved since."""
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    with pytest.raises(CacheMiss):
        safe_files.kept_file(ours, "key", ".o")
    safe_files.keep_file(ours, "another", ".o", lambda out: out.write_bytes(b"object") and None)
    with pytest.raises(CacheMiss):
        safe_files.kept_file(ours, "key", ".o")
    before = ours.stat().st_mtime_ns
    kept = safe_files.keep_file(theirs, "key", ".o", lambda out: out.write_bytes(b"object") and None)
    with pytest.raises(CacheMiss):
        safe_files.kept_file(ours, "key", ".o")
    path = kept.rename(ours / kept.name)
    os.utime(ours, ns=(before + 10**9, before + 10**9))
    assert safe_files.kept_file(ours, "key", ".o") == path
    path.unlink()
    os.utime(ours, ns=(before + 10**9, before + 10**9))
    with pytest.raises(CacheMiss):
        safe_files.kept_file(ours, "key", ".o")


def test_the_key_and_the_suffix_are_whole(tmp_path: Path) -> None:
    paths = {
        (key, suffix): safe_files.keep_file(tmp_path, key, suffix, lambda out: out.write_bytes(b"object") and None)
        for key in ("key", "key2", "ke")
        for suffix in (".o", ".so")
    }
    assert {of: safe_files.kept_file(tmp_path, *of) for of in paths} == paths


def test_ignore_cache_skips_older_entries(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    safe_files.keep_json(path, 1)
    file = safe_files.keep_file(tmp_path, "key", ".o", lambda out: out.write_bytes(b"old") and None)
    now = safe_files.filesystem_time(tmp_path)
    for p in (path, file):
        os.utime(p, ns=(now - 1, now - 1))
    with safe_files.ignore_cache(now):
        with pytest.raises(CacheMiss):
            safe_files.kept_json(path)
        with pytest.raises(CacheMiss):
            safe_files.kept_file(tmp_path, "key", ".o")
        safe_files.keep_json(path, 2)
        assert safe_files.kept_json(path) == 2
    assert safe_files.kept_file(tmp_path, "key", ".o") == file
