"""Pipeline of a run: launch, collect, analyse, write; `prepare_run` loads and validates before it."""

from pathlib import Path
from typing import Any

from skinnet.run.analyse import RunAnalysis
from skinnet.run.collect import collect
from skinnet.run.launch import launch
from skinnet.run.prepare import PreparedRun
from skinnet.run.progress import ProgressDisplay
from skinnet.run.summary import summarise
from skinnet.run.write import write_deployment, write_summary

__all__ = ["run_once"]


def run_once(prepared: PreparedRun, out: Path, progress: ProgressDisplay) -> dict[str, Any]:
    """Run a prepared deployment once, write run folder `out`, and return the summary.

    The plots come after the summary, which a plot that fails must not cost.

    Raises:
        SkinnetError: the run failed; the text is one line.
    """
    write_deployment(prepared, out)
    launched = launch(prepared, out, progress)
    outcome = collect(launched.ended, out)
    analysis = RunAnalysis(prepared, outcome)
    summary = summarise(prepared, launched, outcome, analysis.metrics)
    write_summary(summary, out)
    if prepared.options.plots:
        for line in analysis.draw_plots(out):
            progress.print_line(line)
    return summary
