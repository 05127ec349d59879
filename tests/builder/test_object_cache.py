"""The object cache: what makes it compile again, and what does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from build_fmus.base.safe_files import DamagedWarning
from build_fmus.compile import ObjectCache, find_toolchain, host, included_headers


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A C file with a header that has a header of its own, and a header that it does not include."""
    folder = tmp_path / "sources"
    (folder / "inner").mkdir(parents=True)
    (folder / "unit.c").write_text('#include <stddef.h>\n  #  include "outer.h"\nint f(void) { return N; }\n')
    (folder / "outer.h").write_text('#include "inner/deep.h"\n')
    (folder / "inner" / "deep.h").write_text('#include "beside.h"\n')
    (folder / "inner" / "beside.h").write_text("#define N 1\n")
    (folder / "other.h").write_text("#define M 1\n")
    return folder


def objects(cache: ObjectCache, sources: Path) -> set[str]:
    cache.library(find_toolchain(host()), [sources / "unit.c"], [sources], "unit")
    return {p.name for p in cache.directory.glob("*.o")}


def test_headers_are_found_through_headers(sources: Path) -> None:
    names = [str(p.relative_to(sources.resolve())) for p in included_headers(sources / "unit.c", [sources])]
    assert names == ["inner/beside.h", "inner/deep.h", "outer.h"]


def test_what_is_not_there_is_left_to_the_compiler(tmp_path: Path) -> None:
    (tmp_path / "unit.c").write_text('#include "string.h"\n')
    assert included_headers(tmp_path / "unit.c", [tmp_path]) == []


def test_an_object_is_compiled_again_when_a_header_that_it_includes_changes(sources: Path, tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path / "cache")
    first = objects(cache, sources)
    assert len(first) == 1
    (sources / "other.h").write_text("#define M 2\n")
    assert objects(cache, sources) == first
    (sources / "inner" / "beside.h").write_text("#define N 2\n")
    assert len(objects(cache, sources) - first) == 1


def test_one_text_as_c_and_as_cpp_is_two_objects(sources: Path, tmp_path: Path) -> None:
    cache, toolchain = ObjectCache(tmp_path / "cache"), find_toolchain(host())
    (sources / "unit.cpp").write_bytes((sources / "unit.c").read_bytes())
    assert len({cache.object(toolchain, sources / name, [sources]) for name in ("unit.c", "unit.cpp")}) == 2


def test_a_flipped_bit_in_an_object_or_a_library_is_found(sources: Path, tmp_path: Path) -> None:
    """What is made of a damaged cache has the bytes of a sound one."""
    cache = ObjectCache(tmp_path / "cache")

    def made() -> bytes:
        return cache.library(find_toolchain(host()), [sources / "unit.c"], [sources], "unit").read_bytes()

    sound = made()
    (object_,) = cache.directory.glob("*.o")
    (library,) = (p for p in cache.directory.iterdir() if p != object_)
    for damaged in ([object_], [library], [object_, library]):
        for path in damaged:
            data = bytearray(path.read_bytes())
            data[len(data) // 2] ^= 4
            path.write_bytes(data)
        with pytest.warns(DamagedWarning) as caught:
            assert made() == sound
        assert [str(w.message).split(" ")[0] for w in caught] == [str(p) for p in damaged]
