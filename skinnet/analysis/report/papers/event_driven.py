"""Published event-driven and clock-driven rates: Bergner et al. 2015 and 2019 [B15, B19]."""

from skinnet.analysis.report.claims import Between, Claim, Equals, LessThanMetrics

__all__ = ["CLAIMS"]

_UR5 = (
    Claim("cells on the arm", "260", "B15", "", ("size.cells",), Equals(260)),
    Claim(
        "event-driven rate, untouched, deployed thresholds",
        "16.45 % of clock-driven",
        "B15",
        "",
        ("send_on_delta.unstimulated.fraction.packets",),
        LessThanMetrics(("send_on_delta.stimulated.fraction.packets",), "when touched"),
        "the paper's thresholds and motion are not known here",
    ),
    Claim(
        "event-driven rate, half of the cells touched, deployed thresholds",
        "47.69 % of clock-driven",
        "B15",
        "",
        ("send_on_delta.stimulated.fraction.packets",),
        LessThanMetrics(("periodic.stimulated.fraction.packets",), "clock-driven"),
        "the paper's thresholds and motion are not known here",
    ),
    Claim(
        "event-driven rate, untouched and touched, nearest thresholds of the sweep",
        "16.45 %, 47.69 %",
        "B15",
        "",
        ("nearest.unstimulated.fraction.packets", "nearest.stimulated.fraction.packets"),
        None,
        "no single threshold gives both",
    ),
    Claim(
        "thresholds that give the published fractions, untouched and touched",
        "not given",
        "B15",
        "",
        ("published.B15.unstimulated.delta_sigmas.packets", "published.B15.stimulated.delta_sigmas.packets"),
    ),
)
_H1 = (
    Claim("cells", "1260", "B19", "", ("size.cells",), Equals(1260)),
    Claim("patches", "47", "B19", "", ("size.patches",), Equals(47)),
    Claim("cells touched", "more than 680", "B19", "", ("size.touched_cells",), Between(681, None)),
    Claim(
        "clock-driven packets",
        "315 000 per s (1260 × 250 Hz)",
        "B19",
        "",
        ("periodic.stimulated.packets_per_s",),
        Between(314_000.0, 316_000.0),
    ),
    Claim(
        "of those, dropped in the modelled network and missing after it",
        "80 000 per s (25 %)",
        "B19",
        "",
        ("periodic.stimulated.dropped", "periodic.stimulated.missing"),
        Equals(0),
        "the published loss was that of the computer, which is not modelled",
    ),
    Claim(
        "event-driven packets, touched",
        "at most 40 000 per s",
        "B19",
        "",
        ("send_on_delta.stimulated.packets_per_s",),
        Between(None, 40_000.0),
    ),
    Claim(
        "their fraction of clock-driven",
        "at most 13 %",
        "B19",
        "",
        ("send_on_delta.stimulated.fraction.packets",),
        Between(None, 0.13),
    ),
    Claim(
        "of those, dropped and missing",
        "negligible",
        "B19",
        "",
        ("send_on_delta.stimulated.dropped", "send_on_delta.stimulated.missing"),
        Equals(0),
    ),
    Claim(
        "CPU of the controller, clock-driven",
        "270 %",
        "B19",
        "",
        ("periodic.stimulated.cpu.controller",),
        Between(None, 2.7),
        "the published computer is of another decade; in real time 1 CPU s per s is 100 %",
    ),
    Claim(
        "CPU of the controller, event-driven",
        "at most 100 %",
        "B19",
        "",
        ("send_on_delta.stimulated.cpu.controller",),
        Between(None, 1.0),
    ),
)

CLAIMS = {"ur5_260": _UR5, "h1_1260": _H1}
"""Claims by name of the deployment."""
