"""Explorations on a simulated body without network or processes: cells read it at every tick."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.deflections import Deflections
from controller.selforganisation.exploration import PositionControl
from controller.selforganisation.kinematic_structure import KinematicStructure
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.selforganisation.structural_exploration import (
    StructuralExploration,
    StructuralExplorationConfig,
)
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.migration.deployments import FORMAT

TICK_NS = 5_000_000
DELAY_TICKS = 1
G_M_S2 = 9.80665

Floats = NDArray[np.float64]


class Watch(NamedTuple):
    """What happened during a program: extremes of the joints (2, D), and pairs of bodies in contact."""

    extremes_rad: Floats
    contacts: set[frozenset[str]]


def deployment_of(folder: Path, mjcf: str, body: dict[str, Any], cells: dict[str, list[str]]) -> Deployment:
    """A deployment of an MJCF text; `cells` has the inline tables of the cells by body."""
    (folder / "robot.xml").write_text(mjcf, encoding="utf-8")
    patches = [
        {
            "name": name,
            "body": name,
            "cells": [dict(zip(("position_m", "normal", "x_axis"), cell, strict=True)) for cell in placed],
            "interfaces": [{"cell": number, "port": 0} for number in range(len(placed))],
        }
        for name, placed in cells.items()
    ]
    raw = {
        "format": FORMAT,
        "name": "explored",
        "robot": "explored",
        "body": {"model": "robot.xml", "reference_body": "base"} | body,
        "patches": patches,
        "controller": {"program": ["structure"], "stages": {"structure": {"kind": "structure"}}},
    }
    return from_document(raw, str(folder / "robot.toml"))


class ExploredRobot:
    """A simulated body with ideal wires: accelerations with noise, touch readings as the cells give them."""

    def __init__(self, deployment: Deployment, folder: Path) -> None:
        self.deployment = deployment
        self.body = BodySimulation(deployment, folder)
        self.n_cells = sum(patch.n_cells for patch in deployment.patches)
        self.cell_names = [
            f"{patch.name}/{cell}" for patch in deployment.patches for cell in range(patch.n_cells)
        ]
        self._noise = np.random.default_rng(5)

    def structure(self, **config: Any) -> tuple[KinematicStructure, Watch]:
        """Structure by gravity, with short windows unless `config` says otherwise."""
        quick: dict[str, Any] = {
            "average_ns": 300_000_000,
            "settle_ns": 300_000_000,
            "position_control": self._control(1.0),
        }
        program = StructuralExploration(
            StructuralExplorationConfig(**quick | config), *self._sizes(), **self._names()
        )
        watch = self._run(program)
        return program.result, watch

    def deflections(self, **config: Any) -> tuple[Deflections, Watch]:
        """Deflections in the present pose."""
        program = MapExploration(
            MapExplorationConfig(**{"position_control": self._control(0.4)} | config),
            *self._sizes(),
            **self._names(),
        )
        watch = self._run(program)
        return program.result, watch

    def _control(self, speed_rad_s: float) -> PositionControl:
        return PositionControl(speed_rad_s=speed_rad_s, range_rad=self.body.range_rad)

    def _sizes(self) -> tuple[int, int, int]:
        return self.body.n_dofs, self.n_cells, self.body.t_ns

    def _names(self) -> dict[str, Any]:
        return {"dof_names": self.deployment.body.joints, "cell_names": self.cell_names}

    def _run(self, program: StructuralExploration | MapExploration) -> Watch:
        cells, commands = np.arange(self.n_cells), [np.zeros(self.body.n_dofs)] * DELAY_TICKS
        extremes_rad = np.tile(self.body.joints(), (2, 1))
        contacts: set[frozenset[str]] = set()
        for _ in range(30_000):
            if program.done:
                return Watch(extremes_rad, contacts)
            t_ns, position_rad = self.body.t_ns, self.body.joints()
            stimulus = self.body.stimulus()
            acceleration_g = stimulus[:, 4:7] / G_M_S2 + 0.005 * self._noise.standard_normal(
                (self.n_cells, 3)
            )
            program.add_samples(cells, np.full(self.n_cells, t_ns), acceleration_g)
            program.add_touch(cells, self._touch(stimulus))
            if isinstance(program, MapExploration):
                program.add_positions(t_ns, position_rad)
            commands.append(program.step(t_ns, position_rad))
            self.body.set_command(commands.pop(0))
            self.body.advance(t_ns + TICK_NS)
            extremes_rad[0] = np.minimum(extremes_rad[0], self.body.joints())
            extremes_rad[1] = np.maximum(extremes_rad[1], self.body.joints())
            contacts |= self._contacts()
        raise AssertionError("the program does not end")

    def _touch(self, stimulus: Floats) -> Floats:
        """Readings (S, 4) of force and proximity, by their calibrations."""
        force, near = self.deployment.cells.force, self.deployment.cells.proximity
        root = np.sqrt(near.reading_at_range)
        d0_m = near.range_m * root / (1.0 - root)
        touch = np.empty((self.n_cells, 4))
        touch[:, :3] = np.interp(stimulus[:, :3], force.calibration_n, force.calibration_reading)
        touch[:, 3] = np.where(np.isfinite(stimulus[:, 3]), (d0_m / (d0_m + stimulus[:, 3])) ** 2, 0.0)
        return touch + [[force.noise] * 3 + [near.noise]] * self._noise.standard_normal((self.n_cells, 4))

    def _contacts(self) -> set[frozenset[str]]:
        mj, data = self.body.model.mj, self.body.data
        pairs = set()
        for contact in data.contact[: data.ncon]:
            if contact.dist < 0.0:
                pairs.add(frozenset(mj.body(int(mj.geom_bodyid[geom])).name for geom in contact.geom))
        return pairs
