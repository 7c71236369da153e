"""Command `skinnet replay`: playback of a recording to a controller or to observers."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from skinnet.cli.completion import complete_deployment
from skinnet.cli.console import (
    BaseOption,
    JsonOption,
    SettingsOption,
    console,
    examples,
    line_printer,
    require_extra,
    write_report,
)
from skinnet.errors import UsageError
from skinnet.suggestions import did_you_mean

if TYPE_CHECKING:
    from skinnet.deployment import Deployment

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet replay runs/one/run.mcap --into controller",
    "skinnet replay runs/one/run.mcap --into controller --set controller.safety.max_joint_speed_rad_s=0.1",
    "skinnet replay runs/one/run.mcap --publish --rate 0.5 --from 70 --until 90 --loop",
)
_TARGETS = ("controller",)


def register(app: typer.Typer) -> None:
    """Register the command `replay`."""
    app.command(epilog=_EXAMPLES)(replay)


def replay(
    recording: Annotated[Path, typer.Argument(metavar="RUN.MCAP", help="Recording of a run.")],
    into: Annotated[
        str | None,
        typer.Option(
            metavar="controller", help="Feeds the recording to a controller and compares its commands."
        ),
    ] = None,
    deployment: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Deployment of the controller; the recorded one unless given.",
            autocompletion=complete_deployment,
        ),
    ] = None,
    settings: SettingsOption = None,
    publish: Annotated[
        bool, typer.Option("--publish", help="Publishes the recording to observers over Zenoh.")
    ] = False,
    rate: Annotated[
        float, typer.Option(min=0.001, max=1000.0, help="Simulated seconds per second of wall time.")
    ] = 1.0,
    begin_s: Annotated[
        float, typer.Option("--from", min=0.0, metavar="S", help="Begin, in simulated time [s].")
    ] = 0.0,
    end_s: Annotated[
        float | None, typer.Option("--until", min=0.0, metavar="S", help="End, in simulated time [s].")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="Waits for the first observer.")] = False,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT", help="Observer endpoint, e.g. tcp/127.0.0.1:7447; a free port unless given."
        ),
    ] = None,
    base: BaseOption = None,
    json: JsonOption = None,
) -> None:
    """Replay a recording of a run.

    With --into, the exit code is 1 if a command of the controller differs from the recorded one.
    """
    if (into is None) == (not publish):
        raise UsageError("give either --into controller or --publish")
    require_extra("record", "mcap", "zstandard")
    if into is not None:
        _replay_into(recording, into, _DeploymentChanges(deployment, tuple(settings or ()), base), json)
        return
    if deployment is not None or settings:
        raise UsageError("--deployment and --set are for --into: --publish changes nothing")
    _publish(recording, (begin_s, end_s, rate, loop), listen, base, wait)


class _DeploymentChanges(NamedTuple):
    """Changes of the deployment relative to the recorded run."""

    file: Path | None
    settings: tuple[str, ...]
    base: Path | None


def _replay_into(path: Path, target: str, changes: _DeploymentChanges, json: str | None) -> None:
    from skinnet.recording.reader import Recording
    from skinnet.recording.replay import replay_into, require_same_robot, with_memory

    if target not in _TARGETS:
        raise UsageError(f"--into {target}: {did_you_mean(target, _TARGETS)}allowed: {', '.join(_TARGETS)}")
    recording = Recording(path)
    recorded = recording.deployment()
    deployment = _deployment(recording.deployment_dict, path, changes)
    require_same_robot(recorded, deployment)
    base = changes.base or (recording.base if changes.file is None else changes.file.parent)
    with with_memory(recording, deployment) as remembering:
        verdict = replay_into(recording, remembering, base)
    difference = verdict.difference
    if difference is not None:
        typer.echo(
            f"different at {difference.t_ns * 1e-9:.3f} s, stage {difference.stage or 'none'}, "
            f"after {verdict.ticks - 1} equal commands: {difference.field} was {difference.recorded}, "
            f"is {difference.replayed}"
        )
        if reason := _other_arithmetic(path, deployment):
            typer.echo(f"{path}: {reason}")
    elif verdict.ticks:
        note = f"; {verdict.note}" if verdict.note else ""
        typer.echo(f"no difference in {verdict.ticks} commands up to {verdict.t_ns * 1e-9:.3f} s{note}")
    else:
        typer.echo(f"nothing to compare: {verdict.note or 'the recording has no commands'}")
    write_report({**verdict._asdict(), "difference": difference and difference._asdict()}, json)
    raise typer.Exit(0 if difference is None else 1)


def _other_arithmetic(path: Path, deployment: "Deployment") -> str:
    """Return why the commands of a recording cannot be compared bit for bit, by the summary beside it."""
    import json

    from skinnet.run.arithmetic import arithmetic, compare_arithmetic, used_parts

    try:
        summary = json.loads((path.parent / "summary.json").read_bytes())
    except (OSError, ValueError):
        return ""
    mine = {"arithmetic": arithmetic(used_parts(deployment))}
    return compare_arithmetic(mine, summary) if isinstance(summary, dict) else ""


def _deployment(raw: dict[str, Any], path: Path, changes: _DeploymentChanges) -> "Deployment":
    """Build the recorded deployment, or load another one, with the changed settings."""
    import msgspec

    from skinnet.covering.covered_deployment import load_covered
    from skinnet.deployment.checks import check
    from skinnet.deployment.load import apply_override, from_document
    from skinnet.migration.deployments import FORMAT, FORMAT_KEY, translate

    if changes.file is not None:
        deployment = load_covered(changes.file, changes.settings)
    else:
        current, _ = translate(msgspec.json.decode(msgspec.json.encode(raw)), str(path))
        changed = {FORMAT_KEY: FORMAT, **current}
        for setting in changes.settings:
            apply_override(changed, setting)
        deployment = from_document(changed, str(path))
    check(deployment)
    return deployment


def _publish(
    path: Path,
    interval: tuple[float, float | None, float, bool],
    listen: str | None,
    base: Path | None,
    wait: bool,
) -> None:
    from skinnet.recording.playback_publisher import PlaybackOptions, publish_recording
    from skinnet.recording.reader import Recording
    from skinnet.run.observers.observer_endpoint import free_endpoint

    begin_s, end_s, rate, loop = interval
    if end_s is not None and end_s <= begin_s:
        raise UsageError(f"--until {end_s:g}: must be later than --from {begin_s:g}")
    recording = Recording(path)
    if begin_s > recording.end_ns * 1e-9:
        raise UsageError(f"--from {begin_s:g}: the recording ends at {recording.end_ns * 1e-9:.3f} s")
    print_line = line_printer(console())
    if not recording.complete:
        print_line(f"the recording is truncated; its last chunk ends at {recording.end_ns * 1e-9:.3f} s")
    until_ns = None if end_s is None else round(end_s * 1e9)
    count = publish_recording(
        recording,
        PlaybackOptions(round(begin_s * 1e9), until_ns, rate, loop),
        listen or free_endpoint(),
        base=base or recording.base,
        wait_for_subscriber=wait,
        log=print_line,
    )
    print_line(f"{count} messages")
