"""Command `skinnet init`: a commented deployment for the robot of a model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skinnet.cli.console import console, examples, line_printer

if TYPE_CHECKING:
    from skinnet.onboarding.onboard import Onboarding

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet init panda.xml --out panda.toml",
    "skinnet init quadruped.xml --out quadruped.toml --template network",
    "skinnet init robot.urdf --out robot.toml --package-path ~/catkin_ws/src",
    "skinnet init two_arms.xml --out grasp.toml --template grasp --force",
)


def register(app: typer.Typer) -> None:
    """Register the command `init`."""
    app.command(epilog=_EXAMPLES)(init)


def init(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="Model of the robot: MJCF or URDF.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="Deployment to write; its folder must exist.")
    ],
    template: Annotated[
        Literal["touch", "grasp", "network"],
        typer.Option(
            help="Program: explore and evade touches; explore and teach two arms; or cells and network alone."
        ),
    ] = "touch",
    package_path: Annotated[
        list[Path] | None,
        typer.Option(
            "--package-path",
            metavar="DIR",
            help="Folder with ROS packages for package:// in a URDF; may be repeated. ROS_PACKAGE_PATH and "
            "the packages above MODEL are looked at afterwards.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replaces FILE if it is there.")] = False,
) -> None:
    """Write a commented deployment for a robot, which runs as it is.

    Chosen are reference body, controlled joints, home pose, servos and skin on all links that take cells;
    each choice stands in the file with its reason.
    """
    from skinnet.onboarding.onboard import onboard
    from skinnet.onboarding.program import Template

    made = onboard(model, out, Template(template), tuple(package_path or ()), overwrite=force)
    _print(made, out)


def _print(made: "Onboarding", out: Path) -> None:
    from skinnet.onboarding.joint_roles import Role

    terminal, plan = console(), made.plan
    print_line = line_printer(terminal)
    n_joints = len(plan.survey.joints(Role.CONTROLLED))
    n_cells = sum(plan.cells.values())
    print_line(f"{out}: {n_joints} joints, {n_cells} cells on {len(plan.skin.bodies)} links")
    for joint, reason in plan.home.faults.blind.items():
        print_line(f"joint {plan.survey.joint_name(joint)}: {reason}")
    for body, reason in plan.skin.left_out.items():
        print_line(f"no skin on {body}: {reason}")
    print_line(f"next: skinnet check {out} --settle 0.5; skinnet run {out}")
