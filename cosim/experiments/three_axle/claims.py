"""What the claims of paper 003 (linear part) in `claims.toml` name: places, controllers and quantities of the runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from cosim.experiments.three_axle.published import SHOWN, places
from cosim.experiments.three_axle.runs import CONTROLLERS, HORIZON, LIMIT, Case
from cosim.study import ClaimList
from cosim.study.judges import Quantities, View, compare


class ThreeAxleView(View):
    """Speeds and depths of Table 5.1, or single runs."""

    made, named = Case, "{:g} km/h, {:g} m"
    quantities: ClassVar[Quantities] = {"steady error": lambda view, subject, _: view.steady_error(subject)}
    words: Mapping[str, float] = {"horizon": HORIZON, "limit": LIMIT}

    def places(self, at: str, road: str) -> list[Any]:  # noqa: ARG002
        """Every speed and depth that the study went to, the one that is shown, all at once, or runs under an MPC."""
        if at == "every run under an MPC":
            every = (c for c in self.study if c.solver_parts == c.exchange_parts == 1)
            return [c for c in every if CONTROLLERS[c.controller] == "MpcThreeAxle"]
        named: dict[str, list[Any]] = {"the run that is shown": [SHOWN], "all runs together": [at]}
        return named.get(at) or list(places(self.study))

    def steady_error(self, subject: str) -> float:
        """Least steady error of the LQR at any place, or the largest of either MPC [deg]."""
        found = {"lqr, least": (["lqr"], min), "either MPC, largest": (["mpc", "mpc-preview"], max)}
        controllers, extreme = found[subject]
        return extreme(self.study[Case(*p, c)]["steady_error_deg"] for c in controllers for p in places(self.study))


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, ThreeAxleView)
