"""Link and cell faults of one process: outages and impairments from the fault schedule of a run."""

import heapq
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from cells.networking.outages import Outage
from cells.networking.wiring import Wiring
from skinnet.deployment.experiment.faults import BitErrors, BurstLoss, CellDead, GatewayLost, LinkCut, Loss
from skinnet.network.faults.fault_schedule import FaultLocation, FaultSpan, gilbert_elliott_phases

__all__ = ["Impairment", "impairments", "outages_of"]


class Impairment(NamedTuple):
    """Loss probability and bit error rate of a link from `t_ns` on."""

    t_ns: int
    link: int
    loss_probability: float
    bit_error_rate: float


class _FaultContribution(NamedTuple):
    """Loss probability and bit error rate that one fault contributes to a link from `t_ns` on."""

    t_ns: int
    link: int
    fault: int
    loss: float
    bit_errors: float


def outages_of(spans: Iterable[FaultSpan], wiring: Wiring) -> Iterator[Outage]:
    """Yield the outages from link cuts, dead cells and lost gateways.

    A cut of both directions severs all four wires, power included; a lost gateway still supplies power.
    """
    patches = {patch.name: p for p, patch in enumerate(wiring.patches)}
    for span in spans:
        if span.location.patch not in patches:
            continue
        match span.rule:
            case LinkCut(direction=direction):
                link = _link(span.location, wiring, patches)
                yield Outage(span.t_ns, span.until_ns, (link,), cuts_power=direction == "both")
            case GatewayLost():
                link = _link(span.location, wiring, patches)
                yield Outage(span.t_ns, span.until_ns, (link, link ^ 1), cuts_power=False)
            case CellDead():
                assert span.location.cell is not None
                cell = int(wiring.first_cell[patches[span.location.patch]]) + span.location.cell
                yield Outage(span.t_ns, span.until_ns, cell=cell)


def impairments(
    spans: Iterable[FaultSpan], wiring: Wiring, *, baseline_loss: float, seed: int
) -> Iterator[Impairment]:
    """Yield link impairments lazily, in order of time; concurrent faults of a link are independent.

    Args:
        spans: Faults of the run.
        wiring: Links of the process.
        baseline_loss: Baseline loss probability of every link.
        seed: Seed of the run.
    """
    patches = {patch.name: p for p, patch in enumerate(wiring.patches)}
    mine = [
        _contributions(number, span, _link(span.location, wiring, patches), seed)
        for number, span in enumerate(spans)
        if isinstance(span.rule, Loss | BitErrors | BurstLoss) and span.location.patch in patches
    ]
    present: dict[int, dict[int, _FaultContribution]] = {}
    for share in heapq.merge(*mine):
        shares = present.setdefault(share.link, {})
        shares[share.fault] = share
        spared, intact = 1.0 - baseline_loss, 1.0
        for other in shares.values():
            spared *= 1.0 - other.loss
            intact *= 1.0 - other.bit_errors
        yield Impairment(share.t_ns, share.link, 1.0 - spared, 1.0 - intact)


def _contributions(fault: int, span: FaultSpan, link: int, seed: int) -> Iterator[_FaultContribution]:
    match span.rule:
        case Loss(probability=probability):
            yield _FaultContribution(span.t_ns, link, fault, probability, 0.0)
        case BitErrors(bit_error_rate=rate):
            yield _FaultContribution(span.t_ns, link, fault, 0.0, rate)
        case BurstLoss():
            for t_ns, probability in gilbert_elliott_phases(span, seed):
                yield _FaultContribution(t_ns, link, fault, probability, 0.0)
    yield _FaultContribution(span.until_ns, link, fault, 0.0, 0.0)


def _link(target: FaultLocation, wiring: Wiring, patches: dict[str, int]) -> int:
    """Return the directed link that leaves by the port of a fault target."""
    patch = patches[str(target.patch)]
    if target.gateway is not None:
        node = int(wiring.interface_node[wiring.group_of_patch[patch]])
        return int(wiring.link_out[node, wiring.gateway_port[patch] + target.gateway])
    assert target.cell is not None
    assert target.port is not None
    return int(wiring.link_out[wiring.node_of_cell[wiring.first_cell[patch] + target.cell], target.port])
