"""Every file that names the version names the same one, and the citation names the papers."""

from __future__ import annotations

import re
import tomllib

import yaml
from built import ROOT

import cosim
from fmu_sources.catalog import PAPERS

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_versions_agree() -> None:
    version = PROJECT["version"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cosim.__version__ == citation["version"] == version
    (first, *_) = re.findall(r"^## (\S+)", (ROOT / "docs" / "changelog.md").read_text(), re.MULTILINE)
    assert first == version


def test_the_citation_names_the_papers() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["license"] == PROJECT["license"]
    assert len(citation["references"]) == len(PAPERS)
    for paper in PAPERS.values():
        found = [r for r in citation["references"] if r["title"] in paper]
        assert len(found) == 1, paper
        assert all(a["family-names"] in paper and a["given-names"] in paper for a in found[0]["authors"])
