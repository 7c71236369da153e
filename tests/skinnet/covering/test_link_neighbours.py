"""Which cells a neighbouring link reaches: over all of it, and from under it where skin feels the link."""

import mujoco
import numpy as np
import pytest

from skinnet.body.contact.contact_problem import RAY_START_DEPTH_M
from skinnet.covering.felt_solids import FeltSolids, felt_solids, link_of_body
from skinnet.covering.link_neighbours import Neighbour, is_reached, join_neighbours

SIDE_M, FOAM_M = 0.014, 0.012
AT_ORIGIN = (np.zeros(3), np.eye(3))
"""A cell in the plane z = 0 whose x axis points to an edge, 12.1 mm away."""


def needle_up_to(z_m: float) -> FeltSolids:
    """A needle 2.4 mm thick that stands upright, its top in the frame of its body at `z_m`."""
    geom = f'<geom type="box" size="0.0012 0.0012 0.05" pos="0 0 {z_m - 0.05}"/>'
    mj = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="a"><joint/>{geom}</body></worldbody></mujoco>'
    )
    return felt_solids(mj, link_of_body(mj, 1))


def is_cell_reached(solids: FeltSolids, at_m: tuple[float, float], *, is_felt: bool) -> bool:
    pose = np.column_stack([np.eye(3), [*at_m, 0.0]])[None]
    neighbours = join_neighbours([Neighbour(solids, pose, is_felt)], none=solids)
    return bool(is_reached(neighbours, *AT_ORIGIN, SIDE_M, FOAM_M))


@pytest.mark.parametrize(
    ("z_m", "of_felt", "of_unfelt"),
    [
        (0.003, True, True),
        (-0.001, True, False),
        (-RAY_START_DEPTH_M + 1e-4, True, False),
        (-RAY_START_DEPTH_M - 1e-4, False, False),
    ],
)
def test_what_is_felt_reaches_a_cell_from_under_it(z_m: float, of_felt: bool, of_unfelt: bool) -> None:
    """The rays of contact start under the rigid surface, so what stands there presses the foam flat."""
    solids = needle_up_to(z_m)
    assert is_cell_reached(solids, (0.0, 0.0), is_felt=True) == of_felt
    assert is_cell_reached(solids, (0.0, 0.0), is_felt=False) == of_unfelt


@pytest.mark.parametrize("along_m", np.linspace(-0.0065, 0.0065, 6))
def test_a_needle_comes_in_nowhere_over_the_rim(along_m: float) -> None:
    edge_m = 0.5 * 3**0.5 * SIDE_M
    assert is_cell_reached(needle_up_to(0.005), (edge_m, along_m), is_felt=False)
    assert not is_cell_reached(needle_up_to(0.005), (edge_m + 0.0015, along_m), is_felt=True)
