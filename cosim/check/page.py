"""The HTML page of checks: one file that loads nothing, in the dress of the reports."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

from build_fmus.base import extras
from cosim.check.report import Report, section

with extras.needed("reports", extras.WRITING):
    import jinja2
    from markupsafe import Markup


def to_html(reports: Sequence[Report]) -> str:
    """The page of one or several FMUs."""
    template = resources.files("cosim.check").joinpath("templates")
    style = resources.files("cosim.report").joinpath("templates", "report.css").read_text(encoding="utf-8")
    style += template.joinpath("check.css").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(template.joinpath("check.html").read_text(encoding="utf-8"))
    title = f"Compliance of {reports[0].path.name}" if len(reports) == 1 else f"Compliance of {len(reports)} FMUs"
    return page.render(reports=reports, title=title, style=Markup(style), section=section)
