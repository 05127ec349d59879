"""Fixtures of the tests of reports."""

import pytest

from cosim.report import Claim, Figure, Panel, Parameter, Report, Result, Section, Series, Table

NAN = float("nan")


@pytest.fixture
def make_report():
    """A small report of every kind of content; keywords replace its fields."""

    def make(**fields):
        histories = Figure(
            "histories",
            "Body motion",
            "Seed 0.",
            [
                Panel(
                    "Pitch",
                    "time [s]",
                    "pitch [deg]",
                    [
                        Series("passive", [0, 1, 2], [0.0, 0.5, NAN], color="gray"),
                        Series("explicit", [0, 1, 2], [0.1, 0.2, 0.3]),
                    ],
                ),
                Panel("Force", "time [s]", "force [kN]", [Series("explicit", [0, 1, 2], [1, 2, 3])]),
            ],
        )
        speeds = Figure(
            "speeds",
            "Over speed",
            "",
            [
                Panel(
                    "Sine",
                    "speed [km/h]",
                    "ratio [-]",
                    [
                        Series("preview", [10, 20], [1, 2], low=[0.5, 1.5], high=[1.5, 2.5], mode="line+markers"),
                        Series("passive", [10, 20, 30], [1, 2, 3]),
                    ],
                ),
                Panel("Curb", "speed [km/h]", "ratio [-]", [Series("preview", [10, 20], [3, 4])]),
            ],
            columns=2,
        )
        table = Table(
            "matched", "Matched", ["road", "speed [km/h]", "gain [-]"], [["sine", 50, 0.123456789], ["curb", 72, NAN]]
        )
        content = {
            "experiment": "gpc",
            "title": "A car on three roads",
            "lead": "Three laws.",
            "claims": [
                Claim("peak", "It peaks", "50 km/h", "", "reproduced", value=52.5, unit="km/h"),
                Claim("power", "It needs power", "1.5", "1.3", "not reproduced", "other road", "Fig. 12"),
            ],
            "sections": [Section("Results", ["Text."], [histories, speeds], [table])],
            "parameters": [Parameter("body.mass", 2813.0, "kg", "Table 1")],
            "provenance": {"versions": {"casadi": "3.8.2"}, "seeds": [0, 1]},
            "results": [Result("Runs", 192), Result("Best", NAN, "-")],
        }
        return Report(**{**content, **fields})

    return make
