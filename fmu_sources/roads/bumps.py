"""A test track of speed bumps at ten places, given by formulas: exact at every position (paper 001, appendix 1.B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import declare_side, is_on, road

PLACES = 10
SPACING = 1.0  # m, so that two places are 6 m apart and all of them fit into the 32 ft of the track
TRACK = {0: 0.057, 6: 0.038}  # m, height of the bump at places; the others are empty
BUMP_LENGTH, CONTACT_LENGTH = 0.305, 0.25  # m
START = 10.0  # m
TRAVEL = 0.06  # m


@dataclass(frozen=True)
class _Bumps:
    """Every value may be a parameter of the component. Lengths, positions and heights in m."""

    heights: Any
    first: Any
    spacing: Any
    length: Any
    contact: Any
    side: Any
    end: Any

    note = (
        "Heights and slopes are exact at every position; there are no nodes. The height under a wheel is the mean of"
        " the profile over the contact length, which is what the wheel follows: without kinks, from half a contact"
        " length before the bump to as much behind it. Beyond its end the road is held at its last height."
    )

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope dz/dx at a column of positions [m]."""
        here = is_on(side, self.side)
        beyond = x > self.end
        x = ca.fmin(x, self.end)
        height, slope = 0, 0
        for place in range(PLACES):
            u = x - self._start(place) - self.length / 2
            height += self.heights[place] * self._mean(u)
            slope += self.heights[place] * (self._parabola(u + self.contact / 2) - self._parabola(u - self.contact / 2))
        rolls = ca.logic_and(here, ca.logic_not(beyond))
        return ca.if_else(here, height, 0), ca.if_else(rolls, slope / self.contact, 0)

    def surface(self, x: Any, side: str) -> Any:
        """Height [m] of the bumps themselves, not averaged over a contact."""
        here = is_on(side, self.side)
        x = ca.fmin(x, self.end)
        bumps = (self.heights[i] * self._parabola(x - self._start(i) - self.length / 2) for i in range(PLACES))
        return ca.if_else(here, sum(bumps), 0)

    def any_beyond_end(self) -> Any:
        """Whether a bump, or the contact of a wheel on it, reaches beyond the end of the road."""
        reach = self.length + self.contact / 2
        return _any((self.heights[i] != 0) * (self._start(i) + reach > self.end) for i in range(PLACES))

    def any_above(self, travel: Any) -> Any:
        """Whether a bump is higher, or a hollow deeper, than `travel`."""
        return _any(ca.fabs(self.heights[i]) > travel for i in range(PLACES))

    def _start(self, place: int) -> Any:
        return self.first + place * self.spacing

    def _parabola(self, u: Any) -> Any:
        """Height over that of the crest, at a distance from the crest."""
        return ca.fmax(0, 1 - (2 * u / self.length) ** 2)

    def _mean(self, u: Any) -> Any:
        """Mean of the parabola over the contact, factored so that it is exactly 0 where the contact is off the bump."""
        half = self.length / 2
        a, b = (ca.fmax(-half, ca.fmin(half, u + sign * self.contact / 2)) for sign in (-1, 1))
        return (b - a) / self.contact * (1 - (a * a + a * b + b * b) / (3 * half * half))


@component("RoadBumps{s}", "test track of speed bumps (paper 001)", of="ride_car_hmmwv", scanned=True)
@component("RoadBumps{s}", "test track of speed bumps as these sensors see it", of="own_sensors", scanned=True)
def road_bumps(layout: RoadLayout, name: str = "RoadBumps") -> Component:
    """Speed bumps across the road at up to ten places (paper 001, appendix 1.B).

    The defaults are the track of the published runs as read here: 57 mm, and 38 mm at 6 m behind it.
    """

    def profile(c: Component) -> _Bumps:
        def length(
            name: str, start: float, text: str, source: str, *, least: float = 1e-3, unit: str | None = None
        ) -> Any:
            return c.parameter(name, start, "m", text, min=least, max=1e5, display_unit=unit, source=source)

        heights = c.parameter(
            "bump.height",
            [TRACK.get(i, 0.0) for i in range(PLACES)],
            "m",
            "height of the bump at each place, 0 for none, negative for a hollow",
            min=-1.0,
            max=1.0,
            display_unit="mm",
            source="001 appendix 1.B (raisers of 38 mm); which bumps stand where: assumed",
        )
        bumps = _Bumps(
            heights=heights,
            first=length("bump.first", START, "where the bump of the first place begins", "assumed", least=-1e5),
            spacing=length("bump.spacing", SPACING, "distance from place to place", "assumed: ten places in 32 ft"),
            length=length("bump.length", BUMP_LENGTH, "length of a bump", "assumed: 12 in", unit="mm"),
            contact=length(
                "contact.length", CONTACT_LENGTH, "length over which the tire averages the road", "assumed", unit="mm"
            ),
            side=declare_side(c, "the bumps are", "001: across the road"),
            end=length("length", 200.0, "length of the road", "assumed", least=1.0),
        )
        travel = c.parameter(
            "travel",
            TRAVEL,
            "m",
            "suspension travel that a bump is compared with",
            min=1e-3,
            max=5.0,
            display_unit="mm",
            source="001 Table 1.3",
        )
        c.output("height_above_travel", bumps.any_above(travel), None, "a bump is higher than travel", type=bool)
        beyond = bumps.any_beyond_end()
        c.output("bumps_beyond_end", beyond, None, "a bump reaches beyond the end of the road", type=bool)
        return bumps

    return road(
        name,
        layout,
        profile,
        description="Speed bumps at up to ten places, on both sides or one (paper 001)",
        source="001 appendix 1.B: bumps, places and raisers; dimensions assumed, see the parameters",
        notes=(
            (
                "A bump is a parabola over bump.length, bump.height high. Averaging over contact.length leaves"
                f" {100 * (1 - (CONTACT_LENGTH / BUMP_LENGTH) ** 2 / 3):.0f} % of that height with the default lengths."
                " Bumps that overlap add up."
            ),
            (
                "The published track has six bumps for ten places in 32 ft; raisers add 38 mm each. The defaults are"
                " the two bumps of the published runs. The run over one big bump: bump.height[1] 0.076 m,"
                " bump.height[7] 0."
            ),
            (
                "height_above_travel tells that a bump is higher than travel (without the averaging), so that the wheel"
                " cannot follow it without the body moving; bumps_beyond_end that a bump is not, or not whole, on the"
                " road. Neither stops a run."
            ),
            (
                "The paper drives at 20 mph (8.94 m/s), and its controllers sample every 30 ms: results depend on where"
                " a bump lies between their samples. Shift bump.first by parts of 0.27 m and average."
            ),
        ),
        reference_start=4.0,
    )


def _any(conditions: Any) -> Any:
    return ca.sum1(ca.vertcat(*conditions)) > 0
