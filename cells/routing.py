"""From what the agents know to what the kernel forwards by: the slow path decides, the fast path follows."""

import numpy as np

from cells.formation_driver import FormationDriver
from cells.wiring import Wiring
from skinnet.network.routes import NO_LINK, Routes

__all__ = ["formed_routes"]


def formed_routes(wiring: Wiring, driver: FormationDriver, patch: int) -> Routes:
    """Routes of a patch by the IDs that its cells know: up by master ports, down by intervals of IDs.

    Packets from a cell are for the interface, packets from the interface for a cell. A node forwards
    whatever else comes by the same rule.
    """
    first = int(wiring.first_cell[patch])
    n_cells = wiring.patches[patch].n_cells
    base, interface = int(wiring.first_node[patch]), int(wiring.interface[patch])
    agents = driver.cells[first : first + n_cells]
    forest = driver.gateways[patch].forest()
    ids = {cell: network_id for network_id, cell in enumerate(forest.uid, start=1)}
    node, dest, link = [], [], []
    for goal in (*sorted(ids), None):
        goal_id, goal_node = (ids[goal], base + goal) if goal is not None else (0, interface)
        for cell in sorted(ids):
            port = agents[cell].next_port(goal_id)
            if port is not None:
                node.append(base + cell)
                dest.append(goal_node)
                link.append(int(wiring.link_out[base + cell, port]))
        if goal is not None:
            node.append(interface)
            dest.append(goal_node)
            link.append(int(wiring.link_out[interface, forest.gateway[goal_id - 1]]))
    columns = (np.array(column, dtype=np.int64) for column in (node, dest, link))
    routes = Routes(*columns)
    assert (routes.link != NO_LINK).all()
    return routes
