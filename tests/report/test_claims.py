"""Verdicts: order and magnitude apart, distributions over seeds, checks of ours counted apart."""

import json
import math

import pytest

from cosim.report import Band, Claim, Distribution, Evidence, write_report
from cosim.report.claims import OUTCOMES, verdict_under
from cosim.report.write import _LOOK, render
from cosim.study import ClaimList, Finding
from cosim.study import Evidence as Looked

TREND = "trend reproduced, magnitude differs"


def verdict(holds=True, **fields):
    (found,) = judged([("c", Finding("ours", holds, "because", **fields))])
    return found


def judged(findings, own=()):
    """Claims that lead to these findings, by id; `own`: additional checks."""
    claims = ClaimList()
    for id, finding in findings:
        claims.claim(id, "it does", published="15 %", source="Figure 1")(lambda _, f=finding: f)
    for id, finding in own:
        claims.check(id, "it does", expected="all")(lambda _, f=finding: f)
    return claims.judge(None)


class TestVerdict:
    def test_order_and_magnitude_are_judged_apart(self):
        band = Band(10, 20)
        assert verdict(value=15, band=band).verdict == "reproduced"
        assert verdict(value=30, band=band).verdict == "trend reproduced, magnitude differs"
        assert verdict(False, value=15, band=band).verdict == "not reproduced"
        assert verdict(value=math.nan, band=band).verdict == "trend reproduced, magnitude differs"

    @pytest.mark.parametrize("edge", [10, 20])
    def test_the_edges_of_a_band_belong_to_it(self, edge):
        assert verdict(value=edge, band=Band(10, 20)).reproduced

    def test_what_the_runs_do_not_decide_is_open_and_says_why(self):
        claim = verdict(undecided="148 m/s2 at half the step, 154 at the whole")
        assert (claim.verdict, claim.reason) == ("open", "148 m/s2 at half the step, 154 at the whole")

    def test_what_a_parameter_was_fitted_to_is_calibrated_and_not_reproduced(self):
        claim = verdict(value=15, band=Band(10, 20), calibrated=True)
        assert (claim.verdict, claim.passed, claim.reproduced, claim.reason) == ("calibrated", True, False, "")
        assert verdict(value=30, band=Band(10, 20), calibrated=True).verdict == "trend reproduced, magnitude differs"
        assert verdict(False, calibrated=True).verdict == "not reproduced"

    @pytest.mark.parametrize(
        ("parts", "under", "together"),
        [
            (("reproduced", "reproduced"), "reproduced", "reproduced"),
            (("reproduced", "calibrated"), "calibrated", "calibrated"),
            (("reproduced", TREND), TREND, TREND),
            (("reproduced", "not reproduced"), "open", "not reproduced"),
            ((TREND, "not reproduced"), "open", "not reproduced"),
            (("reproduced", "open"), "open", "open"),
            (("not reproduced", "not reproduced"), "not reproduced", "not reproduced"),
        ],
    )
    def test_a_claim_under_conditions_and_one_about_several(self, parts, under, together):
        assert verdict_under(parts) == under
        assert verdict_under(parts, together=True) == together

    def test_a_reason_is_kept_only_where_something_is_missing(self):
        assert verdict(value=15, band=Band(10, 20)).reason == ""
        assert verdict(value=30, band=Band(10, 20)).reason == "because"

    def test_the_criterion_names_the_band(self):
        claim = verdict(value=3, unit="times", band=Band(2.5, 3.5, "near threefold"), criterion="passive is worse")
        assert claim.criterion == "passive is worse; magnitude between 2.5 and 3.5 times (near threefold)"

    def test_a_band_without_a_value_is_a_mistake(self, raises):
        with raises(ValueError):
            verdict(band=Band(1, 2))


class TestDistributionAsValue:
    """A value that is the median of a distribution."""

    def test_the_median_is_the_value(self):
        claim = verdict(over=Distribution([14, 15, 19]), band=Band(10, 20))
        assert (claim.verdict, claim.value) == ("reproduced", 15)

    def test_a_bound_holds_clearly_and_not_in_the_median_alone(self):
        bound = Band(25, math.inf)
        seeds = Distribution([30] * 6 + [20] * 2)
        assert verdict(value=seeds.median, band=bound).reproduced
        split = verdict(over=seeds, band=bound)
        assert split.verdict == "trend reproduced, magnitude differs"
        assert split.criterion == "magnitude at least 25 in a significant majority of the seeds"
        assert verdict(over=Distribution([30] * 7 + [20]), band=bound).reproduced

    def test_a_value_beside_it_is_a_mistake(self, raises):
        with raises(ValueError):
            verdict(value=15, over=Distribution([15]))


class TestEvidence:
    def test_what_was_looked_at_is_kept(self):
        seen = Looked()
        assert seen.is_significant("ratio, 60 km/h", Distribution([2.0] * 7 + [0.123456]), lambda x: x > 1)
        assert not seen.is_significant("ratio, 70 km/h", Distribution([2.0] * 6 + [0.5] * 2), lambda x: x > 1, "W")
        assert not seen.is_significant("ratio, 80 km/h", None, lambda x: x > 1)
        first, second = (e.row() for e in judged([("power", Finding("x", True, evidence=seen))]).evidence)
        assert dict(zip(Evidence.COLUMNS, first, strict=True)) == {
            "claim": "power",
            "quantity": "ratio, 60 km/h",
            "unit": "-",
            "median": 2.0,
            "lowest": 0.1235,
            "lower quartile": 2.0,
            "upper quartile": 2.0,
            "highest": 2.0,
            "on the claimed side": 7,
            "of": 8,
        }
        assert second[-2:] == [6, 8]

    def test_quartiles_are_values_that_occurred(self):
        """The second and the sixth of eight."""
        evidence = Evidence("power", "power", "W", Distribution([7, 3, 5, 1, 8, 2, 6, 4]), 8)
        row = dict(zip(Evidence.COLUMNS, evidence.row(), strict=True))
        spread = [row[c] for c in ("lowest", "lower quartile", "median", "upper quartile", "highest")]
        assert spread == [1, 2, 4.5, 6, 8]
        assert Distribution([math.inf, 1, math.inf]).quantile(0.75) == math.inf
        assert math.isnan(Distribution([math.nan, 1, 2]).quantile(0.25))


class TestBand:
    def test_ten_percent_around_a_single_figure(self):
        band = Band.around(60)
        assert (band.low, band.high) == pytest.approx((54, 66))
        assert Band.around(-60).low == pytest.approx(-66)

    def test_another_width_needs_its_reason(self, raises):
        with raises(ValueError):
            Band.around(60, 0.2)
        assert Band.around(60, 0.2, "read off a figure").reason == "read off a figure"

    def test_an_empty_band_is_refused(self, raises):
        with raises(ValueError):
            Band(2, 1)
        with raises(ValueError):
            Band(math.nan, 1)

    def test_words(self):
        assert Band(2, 15).text("%") == "between 2 and 15 %"
        assert Band(2, math.inf).text() == "at least 2"
        assert Band(7, 7).text("of 7") == "7 of 7"
        assert Band(-math.inf, 0.5).text("m") == "at most 0.5 m"


class TestDistribution:
    def test_one_lucky_seed_does_not_move_it(self):
        seeds = Distribution([0.20, 0.02, 0.03, -0.04, 0.01, 0.03, -0.01, 0.02])
        assert seeds.median == pytest.approx(0.02)
        assert seeds.count(lambda x: x > 0) == 6
        assert not seeds.is_significant(lambda x: x > 0)

    @pytest.mark.parametrize(("n", "fewest"), [(5, 5), (8, 7), (16, 12)])
    def test_clearly_is_a_sign_test_at_five_percent(self, n, fewest):
        def on_side(k):
            return Distribution([1.0] * k + [-1.0] * (n - k)).is_significant(lambda x: x > 0)

        assert on_side(fewest)
        assert not on_side(fewest - 1)

    def test_nan_is_on_no_side(self):
        seeds = Distribution([1.0, math.nan])
        assert seeds.count(lambda x: x > 0) == 1
        assert seeds.count(lambda x: x <= 0) == 0
        assert math.isnan(seeds.median)

    def test_everywhere_and_words(self):
        speeds = Distribution([10, 20, 40], of="speeds")
        assert speeds.everywhere(lambda x: x > 5)
        assert not speeds.everywhere(lambda x: x > 10)
        assert speeds.text("{:.0f}", "W", lambda x: x > 10) == "median 20 W (10 to 40 W over 3 speeds; holds in 2 of 3)"

    def test_nothing_is_no_distribution(self, raises):
        with raises(ValueError):
            Distribution([])


class TestCounts:
    @pytest.fixture
    def report(self, make_report):
        findings = [(True, 15, False), (True, 15, False), (True, 40, False), (False, 0, False), (True, 12, True)]
        published = [
            (f"c{i}", Finding("", holds, "because", value, "%", Band(10, 20), calibrated=calibrated))
            for i, (holds, value, calibrated) in enumerate(findings)
        ]
        own = [("solver", Finding("all", True)), ("kept", Finding("7", False, "no", fitted="the mass"))]
        return make_report(claims=judged(published, own))

    def test_checks_are_counted_apart(self, report):
        assert list(report.counts.verdicts) == list(OUTCOMES)
        assert list(report.counts.verdicts.values()) == [2, 1, 1, 0, 1]
        assert (report.counts.published, report.counts.reproduced) == (5, 2)
        assert (report.counts.checks_held, report.counts.checks) == (1, 2)

    def test_summary_and_page_say_the_same(self, report, tmp_path):
        page = write_report(report, tmp_path).read_text(encoding="utf-8")
        data = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
        assert data["verdicts"] == dict(zip(OUTCOMES, (2, 1, 1, 0, 1), strict=True))
        assert (data["claims_total"], data["checks_total"], data["checks_held"]) == (5, 2, 1)
        assert [c["own"] for c in data["claims"]] == [False] * 5 + [True] * 2
        assert page.count('<span class="chip order">') == 1
        assert "1 trend reproduced, magnitude differs</span>" in page
        assert "<dt>Fitted</dt><dd>the mass</dd>" in page
        assert all(page.count(f"<code>{c['id']}</code>") == 1 for c in data["claims"]), (
            "tables and words name claims by id"
        )
        assert "<dt>Criterion</dt><dd>magnitude between 10 and 20 %</dd>" in page
        assert page.index('id="claim-c3"') < page.index('id="checks-title"') < page.index('id="claim-solver"')

    def test_every_verdict_has_a_look_of_its_own(self):
        assert len({look["style"] for v, look in _LOOK.items() if v in OUTCOMES}) == len(OUTCOMES)

    def test_only_checks_give_no_table_of_claims(self, make_report):
        page = render(make_report(claims=[Claim("c", "it", "1", "1", "holds")]))
        assert 'id="claims"' not in page
        assert 'id="checks"' in page
        assert "<dt>Additional checks passed</dt>\n    <dd><b>1</b> of 1</dd>" in page


def test_most_is_not_always_clearly_most():
    """14 of 20 may be chance (5.8 %), 15 of 20 hardly (2.1 %)."""
    for many, clear in ((14, False), (15, True)):
        assert Distribution([1.0] * many + [0.0] * (20 - many)).is_significant(bool) is clear
