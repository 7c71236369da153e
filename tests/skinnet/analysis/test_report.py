"""The report: everything of a run in one page that opens anywhere, and one clear line for what is no run."""

import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
from launching import skinnet
from locations import ROOT, SHIPPED_DEPLOYMENTS
from reported import ARM, SHORT, Page, browser, png, small_run

from skinnet.analysis.report.claims import (
    Between,
    Claim,
    Equals,
    LessThanMetrics,
    RelativeTolerance,
    Verdict,
    evaluate_claim,
)
from skinnet.analysis.report.deployment_metrics import deployment_metrics
from skinnet.analysis.report.html import render_html
from skinnet.analysis.report.markup import Html, join, tag
from skinnet.analysis.report.metric_groups import group_metrics, group_over_seeds
from skinnet.analysis.report.papers import CLAIMS, SOURCES
from skinnet.analysis.report.pictures import read_pictures
from skinnet.analysis.report.run_folder import RunResults, SeedResults, StressResults, read_run_folder
from skinnet.analysis.report.summary_section import kept_count
from skinnet.analysis.report.toml_listing import sections
from skinnet.analysis.report.units import format_number, format_value, parse_quantity
from skinnet.deployment import load
from skinnet.deployment.load import from_document
from skinnet.errors import RunFolderError, SkinnetError
from skinnet.migration.summaries import current_metric


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with all its plots, and the picture of the body whether or not this machine can render one."""
    folder = tmp_path_factory.mktemp("runs") / "arm"
    small_run(folder)
    if not (folder / "body.png").exists():
        (folder / "body.png").write_bytes(png())
    return folder


@pytest.fixture(scope="module")
def several(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seeds, as `skinnet run --seeds` leaves them."""
    several = tmp_path_factory.mktemp("runs") / "several"
    runs = []
    for seed in (1, 2):
        shutil.copytree(folder, several / f"seed-{seed}")
        one = json.loads((folder / "summary.json").read_text()) | {"seed": seed}
        one["metrics"] |= {"reaction.count": seed, "contact.peak_force_n": 2.0 * seed}
        runs.append(one)
    (several / "summary.json").write_text(json.dumps({"runs": runs}))
    return several


def sweep(folder: Path) -> Path:
    """A sweep of H-1 as `skinnet stress` leaves it, with a point that failed."""
    folder.mkdir()
    own = {
        "packets_per_s": 36_000.0,
        "fraction.packets": 0.114,
        "latency_us.p50": 958.0,
        "latency_us.p99": 2491.0,
    }
    headline = {
        "periodic.stimulated.packets_per_s": 315_000.0,
        "send_on_delta.stimulated.packets_per_s": 36_000.0,
        "send_on_delta.stimulated.fraction.packets": 0.114,
        "send_on_delta.stimulated.dropped": 0,
        "send_on_delta.stimulated.missing": 3,
        "delta.force": 0.02,
        "noise.force": 0.004,
        "delta_sigmas.force": 5.0,
    }
    stress = {
        "deployment": "h1_1260",
        "stress": {"duration_s": 4.0},
        "points": ["c1260-send_on_delta-s0.55", "c1260-periodic-s0.55"],
        "failed": {"c1260-periodic-s0.55": "cells0 was killed by signal 9"},
        "metrics": headline | {f"c1260-send_on_delta-s0.55.{name}": value for name, value in own.items()},
    }
    (folder / "stress.json").write_text(json.dumps(stress))
    (folder / "rates.png").write_bytes(png())
    return folder


def page_of(folder: Path) -> Page:
    return Page(render_html(read_run_folder(folder)))


# The page


def test_a_page_has_every_figure_and_every_picture(folder: Path) -> None:
    page = page_of(folder)
    summary = json.loads((folder / "summary.json").read_text())
    named = {row["title"] for row in page.all("tr") if "title" in row}
    for name, value in summary["metrics"].items():
        assert name in named or name.rpartition(".")[0] in named, name
        if isinstance(value, int) and not isinstance(value, bool):
            assert format_number(value) in page.text
    pictures = sorted(path.name for path in folder.glob("*.png"))
    assert len(pictures) >= 4
    assert len(page.all("img")) == len(pictures)
    assert all(name in page.text for name in pictures)


def test_a_page_tells_how_the_run_was(folder: Path) -> None:
    page = page_of(folder)
    summary = json.loads((folder / "summary.json").read_text())
    for told in ("completed", summary["log_sha256"], "in_process", "lockstep", *SHORT):
        assert told in page.text
    for name, version in summary["environment"].items():
        assert name in page.text
        assert str(version) in page.text


def test_a_page_is_whole_and_loads_nothing(folder: Path, several: Path, tmp_path: Path) -> None:
    for one in (folder, several, sweep(tmp_path / "sweep")):
        page = page_of(one)
        ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
        assert len(ids) == len(set(ids))
        assert {link["href"] for link in page.all("a")} <= {f"#{key}" for key in ids}
        assert all(image["src"].startswith("data:image/png;base64,") for image in page.all("img"))
        assert all(image["alt"] and image["width"] != "0" for image in page.all("img"))
        assert [link["href"] for link in page.all("link")] == ["data:,"]
        assert page.all("script") == []
        assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
        style = "".join(data for where, data in page.texts if where == "style")
        assert "url(" not in style
        assert "@import" not in style


def test_the_same_folder_gives_the_same_page(folder: Path) -> None:
    assert render_html(read_run_folder(folder)) == render_html(read_run_folder(folder))


def test_what_is_lost_counted_or_new_is_told(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "run")
    summary = json.loads((folder / "summary.json").read_text())
    summary |= {
        "outcome": "completed_with_losses",
        "process_failures": [
            {"process": "left", "cause": "was killed by signal 9", "last_lines": ["out of memory"]}
        ],
        "counters": {"controller": {"lost_upstreams": 4}},
        "recording": {"channels": {"joints": 1234}},
    }
    (tmp_path / "run" / "summary.json").write_text(json.dumps(summary))
    text = page_of(tmp_path / "run").text
    for told in (
        "completed with losses",
        "was killed by signal 9",
        "out of memory",
        "controller: lost_upstreams",
    ):
        assert told in text
    assert "recording.channels.joints" in text


EVIL = '"><script>alert(1)</script><img src=x onerror=alert(2)>\x00\u202e'


def test_nothing_from_a_file_becomes_markup(folder: Path, tmp_path: Path) -> None:
    """Names, values, lines, settings and files that try to be HTML; the browser test opens the same page."""
    page = page_of(hostile(folder, tmp_path / "run"))
    assert page.all("script") == []
    assert all(image["src"].startswith("data:image/png;base64,") for image in page.all("img"))
    assert page.text.count("<script>alert(1)</script>") >= 8
    assert not {"\x00", "\u202e"} & set(page.text)


def hostile(folder: Path, out: Path) -> Path:
    shutil.copytree(folder, out)
    (out / '"><b onclick=x>.png').write_bytes(png())
    (out / "touch.png").write_bytes(b"<script>alert(1)</script>")
    summary = json.loads((folder / "summary.json").read_text())
    summary["processes"][0] |= {"name": EVIL, "role": EVIL}
    summary |= {
        "outcome": EVIL,
        "deployment": EVIL,
        "log_sha256": EVIL,
        "pace": EVIL,
        "process_failures": [{"process": EVIL, "cause": EVIL, "last_lines": [EVIL]}],
        "counters": {EVIL: {EVIL: EVIL}},
        "environment": {EVIL: EVIL},
        "settings": [EVIL],
        EVIL: EVIL,
    }
    summary["metrics"] |= {EVIL: 1, f"structure.{EVIL}": EVIL}
    (out / "summary.json").write_text(json.dumps(summary))
    keys = json.loads((folder / "deployment.json").read_text())
    keys["body"] |= {"model": EVIL, "home_rad": {EVIL: 0.5}}
    (out / "deployment.json").write_text(json.dumps(keys))
    return out


def test_a_deployment_of_another_version_is_shown_as_it_is(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "run")
    keys = json.loads((folder / "deployment.json").read_text()) | {"colour": "blue"}
    (tmp_path / "run" / "deployment.json").write_text(json.dumps(keys))
    text = page_of(tmp_path / "run").text
    assert "another version of skinnet" in text
    assert "colour" in text
    (tmp_path / "run" / "deployment.json").unlink()
    assert "no deployment.json" in page_of(tmp_path / "run").text


def test_seeds_are_summed_up(several: Path) -> None:
    results = read_run_folder(several)
    assert isinstance(results, SeedResults)
    assert [run.summary.seed for run in results.runs] == [1, 2]
    page = page_of(several)
    assert len(page.all("img")) == 2 * len(list((several / "seed-1").glob("*.png")))
    assert "2 of 2" in page.text
    assert "Metrics over all seeds" in page.text


def test_seeds_of_two_arithmetics_are_said_to_be_incomparable(several: Path, tmp_path: Path) -> None:
    folder = tmp_path / "several"
    shutil.copytree(several, folder)
    said = "The runs were computed with 2 different arithmetics"
    for digests, expected in ((("a", "a"), False), (("a", "b"), True)):
        whole = json.loads((folder / "summary.json").read_text())
        for run, digest in zip(whole["runs"], digests, strict=True):
            run["arithmetic"] = {"all": digest}
        (folder / "summary.json").write_text(json.dumps(whole))
        assert (said in page_of(folder).text) == expected


def test_a_sweep_is_a_row_for_each_point(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "sweep")
    results = read_run_folder(folder)
    assert isinstance(results, StressResults)
    verdicts = {compared.claim.metrics[0]: compared.verdict for compared in results.comparisons}
    assert verdicts["periodic.stimulated.packets_per_s"] is Verdict.WITHIN
    assert verdicts["send_on_delta.stimulated.dropped"] is Verdict.OUTSIDE  # three went missing
    assert verdicts["periodic.stimulated.cpu.controller"] is Verdict.UNMEASURED
    page = page_of(folder)
    for told in ("c1260-send_on_delta-s0.55", "failed: cells0 was killed by signal 9", "11.4", "958", "5 σ"):
        assert told in page.text
    assert "c1260-send_on_delta-s0_55" not in page.text


# Folders that are none


def broken(kind: str, folder: Path, good: Path) -> str:
    """Makes a folder that cannot be reported; returns what its line must say."""
    summary = folder / "summary.json"
    if kind == "missing":
        return "there is no such folder"
    if kind == "a file":
        folder.write_text("{}")
        return "there is no such folder"
    folder.mkdir()
    if kind == "something else":
        (folder / "notes.txt").write_text("milk")
        return "neither summary.json nor stress.json"
    if kind == "unfinished run":
        shutil.copy(good / "deployment.json", folder)
        (folder / "logs").mkdir()
        return f"failed, was stopped, or is still going on; {folder / 'logs'}"
    if kind == "unfinished sweep":
        (folder / "c74-clock").mkdir()
        (folder / "c74-clock" / "point.json").write_text("{}")
        return "--resume"
    if kind == "unfinished seeds":
        (folder / "seed-1").mkdir()
        shutil.copy(good / "deployment.json", folder / "seed-1")
        return "not all seeds are finished"
    whole = (good / "summary.json").read_text()
    texts = {
        "cut": (whole[: len(whole) // 2], "summary.json: damaged"),
        "no text": ("\x00\x01", "summary.json: damaged"),
        "a list": ("[]", "must be a JSON object"),
        "no runs": ('{"runs": []}', "runs must be a list of summaries"),
        "key missing": (json.dumps({"outcome": "completed"}), "required field"),
        "wrong type": (json.dumps(json.loads(whole) | {"rtf": "fast"}), "rtf"),
    }
    if kind == "damaged deployment":
        summary.write_text(whole)
        (folder / "deployment.json").write_text("{")
        return "deployment.json: damaged"
    if kind == "damaged sweep":
        (folder / "stress.json").write_text("{}")
        return "stress.json: damaged"
    text, told = texts[kind]
    summary.write_text(text)
    return told


KINDS = (
    "missing",
    "a file",
    "something else",
    "unfinished run",
    "unfinished sweep",
    "unfinished seeds",
    "cut",
)
KINDS += ("no text", "a list", "no runs", "key missing", "wrong type", "damaged deployment", "damaged sweep")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_finished_run_is_refused(kind: str, folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "run"
    told = broken(kind, target, folder)
    with pytest.raises(RunFolderError) as caught:
        read_run_folder(target)
    line = str(caught.value)
    assert told in line
    assert line.startswith(str(target))
    assert "\n" not in line


def test_a_run_that_fails_takes_the_summary_of_an_earlier_one_away(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: Any) -> None:
        raise SkinnetError("cells0 is gone")

    shutil.copytree(folder, tmp_path / "run")
    monkeypatch.setattr("skinnet.run.launch.run_in_process", fail)
    with pytest.raises(SkinnetError, match="cells0"):
        small_run(tmp_path / "run")
    with pytest.raises(RunFolderError, match="failed, was stopped"):
        read_run_folder(tmp_path / "run")


def test_the_command_writes_the_page_or_one_line(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "arm.html"
    done = skinnet("report", str(folder), "--out", str(out))
    assert (done.returncode, done.stderr) == (0, "")
    assert str(out) in done.stdout
    assert out.read_text(encoding="utf-8") == render_html(read_run_folder(folder))
    for arguments, told in (
        ((str(tmp_path),), "not a run folder"),
        ((str(folder), "--out", str(tmp_path)), "folder"),
    ):
        done = skinnet("report", *arguments)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1
        assert told in done.stderr


def test_pictures_that_are_none_are_named(tmp_path: Path) -> None:
    (tmp_path / "zebra_crossing.png").write_bytes(png(7, 5))
    (tmp_path / "touch.png").write_bytes(png()[:-5])
    (tmp_path / "body.png").write_bytes(png())
    found, damaged = read_pictures(tmp_path)
    assert [(p.name, p.title, p.width, p.height) for p in found] == [
        ("body", "The body", 3, 2),
        ("zebra_crossing", "Zebra crossing", 7, 5),
    ]
    assert damaged == ["touch.png"]


# The deployment as run


@pytest.mark.parametrize("path", SHIPPED_DEPLOYMENTS, ids=lambda path: path.stem)
def test_the_deployment_as_run_is_that_deployment(path: Path) -> None:
    settings = ("run.max_s=7.5", 'body.body_temperature_c={"odd name"=30.0}')
    deployment = load(path, settings)
    lines = [line for section in sections(deployment) for line in section.lines]
    assert from_document(tomllib.loads("\n".join(line.text for line in lines)), path.stem) == deployment
    told = {line.text: line for line in lines}
    assert told["max_s = 7.5"].differs
    assert told["max_s = 7.5"].default == "300.0"
    assert not told['pace = "lockstep"'].differs


def test_only_what_differs_from_the_defaults_is_marked() -> None:
    usual = {section.title: section for section in sections(load(ARM))}
    assert usual["[network]"].note == "defaults"
    assert not any(line.differs for line in usual["[network]"].lines)
    changed = sections(
        load(ARM, ("network.loss=0.25", 'faults=[{kind="link_cut", target="base/0:1", at_s=1}]'))
    )
    network = next(section for section in changed if section.title == "[network]")
    assert network.note == "1 set"
    assert [line.text for line in network.lines if line.differs] == ["loss = 0.25"]
    general = "\n".join(line.text for section in changed for line in section.lines)
    assert '{ kind = "link_cut", target = "base/0:1", at_s = 1.0 }' in general


# The papers


def claim(*figures: str, expected: Any = None, when: Any = ()) -> Claim:
    return Claim("what", "says", "M14", "VI", figures or ("x.a_n",), expected, conditions=when)


@pytest.mark.parametrize(
    ("expected", "metrics", "text", "verdict"),
    [
        (Equals(0), {"a": 0}, "0 N", Verdict.WITHIN),
        (Equals(0), {"a": 1}, "0 N", Verdict.OUTSIDE),
        (Equals(True), {"a": True}, "yes", Verdict.WITHIN),
        (Between(1.0, 2.0), {"a": 2.0}, "1 to 2 N", Verdict.WITHIN),
        (Between(1.0, 2.0), {"a": 2.1}, "1 to 2 N", Verdict.OUTSIDE),
        (Between(None, 2.0), {"a": -9.0}, "at most 2 N", Verdict.WITHIN),
        (Between(1.0, None), {"a": 0.5}, "at least 1 N", Verdict.OUTSIDE),
        (LessThanMetrics(("x.b",), "b"), {"a": 1.0, "b": 2.0}, "less than b", Verdict.WITHIN),
        (LessThanMetrics(("x.b",), "b"), {"a": 2.0, "b": 2.0}, "less than b", Verdict.OUTSIDE),
        (LessThanMetrics(("x.b",), "b"), {"a": 2.0}, "less than b", Verdict.UNMEASURED),
        (RelativeTolerance(("x.b",), 0.3, "b"), {"a": 7.0, "b": 10.0}, "within 30 % of b", Verdict.WITHIN),
        (RelativeTolerance(("x.b",), 0.3, "b"), {"a": 6.9, "b": 10.0}, "within 30 % of b", Verdict.OUTSIDE),
        (RelativeTolerance(("x.b",), 0.3, "b"), {"a": 6.9}, "within 30 % of b", Verdict.UNMEASURED),
        (Between(1.0, 2.0), {}, "1 to 2 N", Verdict.UNMEASURED),
        (Between(1.0, 2.0), {"a": "lost"}, "1 to 2 N", Verdict.UNMEASURED),
        (None, {"a": 3.0}, "–", Verdict.NO_EXPECTATION),
    ],
)
def test_an_expectation_and_its_verdict(expected: Any, metrics: Any, text: str, verdict: Verdict) -> None:
    names = {"a": "x.a_n", "b": "x.b"}
    compared = evaluate_claim(
        claim(expected=expected), {names[key]: value for key, value in metrics.items()}, {}
    )
    assert compared is not None
    assert compared.verdict is verdict
    assert compared.expected.replace("\u00a0", " ") == text


def test_a_claim_says_nothing_of_another_experiment() -> None:
    blind = claim(when=(("nursing.feedback", ("none",)),))
    assert evaluate_claim(blind, {"x.a_n": 1.0}, {"nursing": {"feedback": "position"}}) is None
    assert evaluate_claim(blind, {"x.a_n": 1.0}, {"nursing": None}) is None
    compared = evaluate_claim(blind, {"x.a_n": 1.0}, {"nursing": {"feedback": "none"}})
    assert compared is not None
    assert compared.measured_text == "1\u00a0N"


@pytest.mark.parametrize("value", [74, 75])
def test_a_setting_is_no_result_and_has_no_verdict(value: int) -> None:
    compared = evaluate_claim(claim("size.cells", expected=Equals(74)), {"size.cells": value}, {})
    assert compared is not None
    assert compared.verdict is Verdict.SETTING
    assert kept_count([compared]) is None, "nor does it count as an expectation that was kept"


def test_every_metric_of_the_deployment_itself_is_a_setting() -> None:
    for path in SHIPPED_DEPLOYMENTS:
        for name in deployment_metrics(load(path)):
            compared = evaluate_claim(claim(name, expected=Equals(0)), {name: 1}, {})
            assert compared is not None
            assert compared.verdict is Verdict.SETTING


@pytest.mark.parametrize("name", sorted(set(CLAIMS) - {"ur5_260", "h1_1260"}))
def test_claims_are_about_metrics_that_a_run_computes(name: str) -> None:
    """A claim on a name that nothing computes is never judged, and nobody sees it."""
    frozen = json.loads((ROOT / "tests/support/frozen_values.json").read_text())["runs"]
    computed = {current_metric(key) for run in frozen.values() for key in run["metrics"]}
    computed |= set(deployment_metrics(load(ROOT / "deployments" / f"{name}.toml")))
    computed |= {f"proximity.onset_distance_mm.{end}" for end in ("min", "max")}
    assert {metric for one in CLAIMS[name] for metric in one.metrics} <= computed


def test_claims_are_well_formed() -> None:
    shipped = {load(path).name for path in SHIPPED_DEPLOYMENTS}
    assert shipped - {"two_link_arm"} <= set(CLAIMS)
    for one in (one for claims in CLAIMS.values() for one in claims):
        assert one.source in SOURCES
        assert one.subject
        assert one.published
        assert all("." in figure for figure in one.metrics)


# Names and numbers


@pytest.mark.parametrize(
    ("name", "label", "unit"),
    [
        ("wrong_entries", "wrong entries", ""),
        ("sim_s", "simulated time", "s"),
        ("latency_us", "latency", "µs"),
        ("velocity_rad_s", "velocity", "rad/s"),
        ("moved_before_contact_rad", "moved before contact", "rad"),
        ("force_n.left", "force, left", "N"),
        ("cop_mm", "centre of pressure", "mm"),
        ("send_on_delta.stimulated.fraction.packets", "send on delta, stimulated, fraction, packets", "%"),
        ("packets_per_s", "packets", "1/s"),
        ("touches", "touches", ""),
    ],
)
def test_names_say_label_and_unit(name: str, label: str, unit: str) -> None:
    meant = parse_quantity(name)
    assert (meant.label, meant.unit) == (label, unit)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (1_788_884, "1\u202f788\u202f884"),
        (1036, "1036"),
        (0.090625, "0.09062"),
        (-3.5, "−3.5"),
        (0.00008, "8.00 × 10⁻⁵"),
        (2.5e6, "2\u202f500\u202f000"),
        (True, "yes"),
        (None, "–"),
        ([], "none"),
        ([1, 2.5, "a"], "1, 2.5, a"),
        (float("nan"), "nan"),
    ],
)
def test_values_are_readable(value: Any, text: str) -> None:
    assert format_value(value) == text


def test_statistics_of_one_quantity_share_a_row() -> None:
    found = group_metrics(
        {"r.count": 3, "r.latency_ms.p50": 1.0, "r.latency_ms.p99": 2.0, "r.way_m.min": 0.5, "points": 4}
    )
    assert [group.title for group in found] == ["R", "The sweep"]
    assert [(row.label, row.texts) for row in found[0].statistics] == [("latency", {"p50": "1", "p99": "2"})]
    assert found[0].columns == ["p50", "p99"]
    assert [(row.label, row.unit) for row in found[0].values] == [("count", ""), ("way, min", "m")]


def test_several_runs_are_spread() -> None:
    (group,) = group_over_seeds(
        [{"x.a_n": 1.0, "x.fell": True}, {"x.a_n": 3.0, "x.fell": False}, {"x.fell": True}]
    )
    assert group.statistics[0].texts == {"least": "1", "median": "2", "greatest": "3"}
    assert group.values[0].texts == {"": "yes: 2, no: 1"}


def test_only_html_stays_html() -> None:
    assert tag("p", "<b>", Html("<i>")) == "<p>&lt;b&gt;<i></p>"
    assert tag("img", alt='"', class_="x", title=None) == '<img alt="&quot;" class="x">'
    assert join("a&", None, ["<", Html("<")]) == "a&amp;&lt;<"


# In a browser


def test_it_opens_offline_with_every_picture(folder: Path, several: Path, tmp_path: Path) -> None:
    folders = (folder, several, sweep(tmp_path / "sweep"), hostile(folder, tmp_path / "hostile"))
    with browser() as chromium:
        for number, one in enumerate(folders):
            path = tmp_path / f"{number}.html"
            path.write_text(render_html(read_run_folder(one)), encoding="utf-8")
            for width in (1280, 400):
                context = chromium.new_context(viewport={"width": width, "height": 900}, offline=True)
                page = context.new_page()
                troubles: list[str] = []
                page.on("console", lambda message, told=troubles: told.append(message.text))
                page.on("pageerror", lambda error, told=troubles: told.append(str(error)))
                page.on(
                    "dialog", lambda dialog, told=troubles: (told.append(dialog.message), dialog.dismiss())
                )
                page.on("requestfailed", lambda request, told=troubles: told.append(request.url[:80]))
                page.goto(path.as_uri())
                widths = page.evaluate(
                    "Array.from(document.images, image => image.complete && image.naturalWidth)"
                )
                assert len(widths) >= 1
                assert all(widths)
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                assert troubles == []
                context.close()


def test_a_picture_opens_in_its_own_size_without_a_script(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "arm.html"
    path.write_text(render_html(read_run_folder(folder)), encoding="utf-8")
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 400, "height": 700}, java_script_enabled=False)
        page.goto(path.as_uri())
        image = page.locator("#plot-0 img")
        assert image.bounding_box()["width"] <= 400
        page.locator("#plot-0 .zoom").click()
        assert image.bounding_box()["width"] == int(image.get_attribute("width"))
        page.locator("#plot-0 .close").click()
        assert image.bounding_box()["width"] <= 400


def test_the_run_says_what_it_ran_with(folder: Path) -> None:
    results = read_run_folder(folder)
    assert isinstance(results, RunResults)
    known = results.summary.environment
    assert {"skinnet", "python", "numpy", "mujoco", "eclipse-zenoh", "platform", "cores"} <= set(known)
    assert results.summary.settings == SHORT
