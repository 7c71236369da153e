"""Pipeline of a run: launch, collect, analyse, write; `prepare_run` loads and validates before it."""

from pathlib import Path
from typing import Any

from skinnet.run.analyse import RunAnalysis
from skinnet.run.collect import collect
from skinnet.run.launch import launch
from skinnet.run.prepare import PreparedRun
from skinnet.run.progress import ProgressDisplay
from skinnet.run.summary import summarise
from skinnet.run.write import own_run_folder, write_deployment, write_summary

__all__ = ["run_once"]


def run_once(prepared: PreparedRun, out: Path, progress: ProgressDisplay) -> dict[str, Any]:
    """Run a prepared deployment once, write run folder `out`, and return the summary.

    The plots come after the summary, which a plot that fails must not cost.

    Raises:
        RunFolderError: the folder is in use, or holds files of others; nothing in it is touched.
        SkinnetError: the run failed; the text is one line.
    """
    with own_run_folder(prepared, out) as folder:
        write_deployment(prepared, out)
        launched = launch(prepared, folder, progress)
        outcome = collect(launched.ended, folder)
        analysis = RunAnalysis(prepared, outcome)
        summary = summarise(prepared, launched, outcome, analysis.metrics, folder.identity)
        write_summary(summary, folder)
        if prepared.options.plots:
            for line in analysis.draw_plots(out):
                progress.print_line(line)
        return summary
