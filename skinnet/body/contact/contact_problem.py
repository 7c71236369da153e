"""Contact of a skin with the solids of one simulation: what is given, what is computed, scratch arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.broad_phase import ActiveCells
from skinnet.body.contact.contact_scene import ContactScene
from skinnet.body.contact.foam import Foam
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.contact.skin_surface import SkinSurface

__all__ = ["RAY_START_DEPTH_M", "ContactProblem", "ContactState", "Workspace"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

RAY_START_DEPTH_M = 0.004
"""Start of rays [m] below the rigid surface: a solid that penetrates this far still counts as in contact."""


class ContactState(NamedTuple):
    """Contact state of a foundation at the present time.

    Attributes:
        force_n: (n, e) normal force on each force cell [N].
        contact_temperature_c: (n,) mean temperature of the bodies on a cell [°C]; NaN without contact.
        body_normal_force_n: (nbody,) normal force of all cells on each body, sum of magnitudes [N].
        patch_body_force_n: (p, nbody) normal force of each patch on each body, sum of magnitudes [N].
        peak_force_n: (1,) the largest force on any force cell [N].
        force_weighted_slip_n_m: (nbody,) sliding distance of each body over the skin in this step times
            normal force [N m]; μ times this is the work of sliding friction.
        shear_m: (n, 2, s) shear displacement of the foam at each point, plane of the cell [m].
        play_m: (n, s) memory of foam with hysteresis (`foam_curve`) at each point [m]; else without entries.
        in_contact: (n,) True for cells in contact.
    """

    force_n: Floats
    contact_temperature_c: Floats
    body_normal_force_n: Floats
    patch_body_force_n: Floats
    peak_force_n: Floats
    force_weighted_slip_n_m: Floats
    shear_m: Floats
    play_m: Floats
    in_contact: NDArray[np.bool_]


class Workspace(NamedTuple):
    """Scratch arrays of one call; points are those of the surface's `SampleGrid`.

    Attributes:
        near: Solids near a patch.
        active: Active cells of one patch; between calls the cells in contact.
        close: Solids close to a cell.
        hit: Solid that the ray of each point meets first, or -1.
        nearest_m: Height at which it does, from `RAY_START_DEPTH_M` below the rigid surface on [m].
        height_m: Height at which the ray of each point meets one solid, from its start on [m].
        at_point: (5, 2 s) shear forces, normal force [N] and shear displacement [m] at the points of a cell.
        inner_grid: Grid that each sample of a cell needs: none, a rough, or a fine one.
    """

    near: Indices
    active: ActiveCells
    close: Indices
    hit: Indices
    nearest_m: Floats
    height_m: Floats
    at_point: Floats
    inner_grid: Indices


class ContactProblem(NamedTuple):
    """Contact of a skin with the solids of one simulation: what is given, and what is computed.

    Compiled code takes it as a `reference`.

    Attributes:
        surface: The cells.
        scene: The solids.
        motion: Poses and velocities now.
        foam: Material of the foam.
        temperature_c: (nbody,) temperatures of the bodies [°C].
        contact: Contact state, overwritten; shear is updated.
        wrench: (nbody, 6) forces [N] and moments [N m] on the bodies about their centres of mass; added to.
        points: Loaded points, overwritten.
        start_depth_m: (n,) largest depth below the rigid surface at which rays start [m].
        workspace: Scratch arrays.
    """

    surface: SkinSurface
    scene: ContactScene
    motion: Motion
    foam: Foam
    temperature_c: Floats
    contact: ContactState
    wrench: Floats
    points: LoadedPoints
    start_depth_m: Floats
    workspace: Workspace
