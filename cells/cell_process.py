"""Cell process: the cells of some patches, simulated one period at a time.

In each period of 4 ms every cell samples once, at its own phase, between the stimuli at the two ends of the
period. Its events and readings enter the network at that instant; data that reach a gateway before the period
ends are published, followed by the period end of each patch.
"""

import logging
import time
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cells.networking.demultiplexer import DeliveredPackets
from cells.networking.link_faults import impairments, outages_of
from cells.networking.link_telemetry import LinkTelemetry
from cells.networking.outages import compute_topology_changes
from cells.networking.packet_pool import PacketKind
from cells.networking.skin_network import SkinNetwork
from cells.networking.wiring import wire_cells
from cells.patch_publisher import PatchPublisher
from cells.sensing.encoding import Encoder, EncoderOutput
from cells.sensing.sensor_faults import SensorFaults
from cells.sensing.transducers import Transducers, noise_keys, phases_ns
from skinnet.clock import NS_PER_S
from skinnet.deployment import Deployment
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.experiment.faults import SlowProcess
from skinnet.errors import ProtocolError
from skinnet.network.faults.fault_schedule import fault_schedule
from skinnet.protocol.channels import BODY, Keys
from skinnet.protocol.messages import READING_NAMES, Config, Stimulus, decode, encode, unpack
from skinnet.protocol.recorded_messages import Counters
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of
from skinnet.skin.placement import place_patch, resolve_bridges

__all__ = ["CellProcess"]

log = logging.getLogger(__name__)

_N_COLUMNS = len(READING_NAMES)


class CellProcess(WiredProcess):
    """Logical process of the cells of some patches and their network.

    Cells are indexed consecutively through the patches of the process. The behaviour of a cell does not
    depend on the other patches of its process.
    """

    def __init__(self, deployment: Deployment, name: str, *, recorded: bool = False) -> None:
        super().__init__(wiring_of(deployment, name, recorded=recorded))
        mine = deployment.patches_by_process()[name]
        placed = tuple(place_patch(patch, deployment.cells) for patch in deployment.patches)
        patches = {patch.name: patch for patch in placed}
        self._patches = tuple(patches[patch] for patch in mine)
        self._patch_index = {patch: i for i, patch in enumerate(mine)}
        keys = Keys(deployment.robot)
        self._body = self.upstreams[BODY]
        self._counters_key = keys.of("counters", name)
        self._period_ns = deployment.cells.period_ns
        self._end_ns = deployment.max_duration_ns
        self._period_index = 0
        self._stimuli: dict[int, NDArray[np.float32]] = {}
        self._configs: list[tuple[int, int, Config]] = []
        groups = [
            [patches[patch] for patch in group] for group in deployment.bridged_patches() if group[0] in mine
        ]
        self.wiring = wire_cells(groups, deployment.network, resolve_bridges(deployment.bridges, placed))
        n_cells = self.wiring.n_cells
        seed = deployment.seed
        self._transducers = Transducers(
            deployment.cells,
            np.concatenate([noise_keys(seed, p.name, p.n_cells) for p in self._patches]),
            np.concatenate([phases_ns(seed, p.name, p.n_cells, self._period_ns) for p in self._patches]),
        )
        self._encoder = Encoder(deployment.cells, n_cells)
        self._readings = np.zeros((n_cells, _N_COLUMNS), dtype=np.float32)
        faults = fault_schedule(deployment, placed)
        self._sensor_faults = SensorFaults(
            faults, dict(zip(mine, self.wiring.first_cell.tolist(), strict=False)), deployment.cells, seed
        )
        self._slow_process_faults = [span for span in faults if span.location.process == name]
        self.network = SkinNetwork(
            self.wiring,
            deployment.cells,
            deployment.network,
            seed,
            topology_changes=compute_topology_changes(
                self.wiring, outages_of(faults, self.wiring), deployment.power, self._fed_cells(deployment)
            ),
            impairments=impairments(faults, self.wiring, baseline_loss=deployment.network.loss, seed=seed),
        )
        self._new_topologies: list[tuple[str, bytes]] = []
        self.telemetry_key = keys.of("links", "*")
        self._link_telemetry = LinkTelemetry(self.wiring, keys)
        self._publishers = [
            PatchPublisher(p.name, keys, deployment.network.aggregate_events) for p in self._patches
        ]

    def _fed_cells(self, deployment: Deployment) -> list[int]:
        """Return the cells of this process that have a power feed."""
        feeds = () if deployment.power is None else deployment.power.feeds
        mine = [feed for feed in feeds if parse_port(feed)[0] in self._patch_index]
        fed_elsewhere = bool(feeds) and not mine
        return [] if fed_elsewhere else self.wiring.skin.feed_cells(mine).tolist()

    def start(self, put: Put) -> None:
        """Start network formation at time 0."""
        self.network.start(0)

    def needs(self) -> dict[str, int] | None:
        """Return the watermark [ns] that the next step needs: stimulus and configurations of its period."""
        end_ns = (self._period_index + 1) * self._period_ns
        if end_ns > self._end_ns:
            return None
        return {BODY: end_ns}

    def due_ns(self) -> int:
        """Return the end of the next period [ns]."""
        return (self._period_index + 1) * self._period_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a stimulus or a configuration.

        Raises:
            ProtocolError: a wrong channel, key, patch, cell or number of cells.
        """
        match channel:
            case "stimulus":
                self._accept_stimulus(decode(payload, Stimulus))
            case "config":
                self._accept_config(fields, decode(payload, Config))
            case _:
                raise ProtocolError(f"a cell process does not subscribe to {channel}")

    def _accept_stimulus(self, stimulus: Stimulus) -> None:
        values = unpack(stimulus.values, "<f4", _N_COLUMNS)
        if len(values) != self.wiring.n_cells:
            raise ProtocolError(f"stimulus of {len(values)} cells; this process has {self.wiring.n_cells}")
        self._stimuli[stimulus.t_ns] = values
        self._body.end_period(stimulus.watermark_ns, stimulus.n_configs)
        if stimulus.end_ns is not None:
            self._end_ns = min(self._end_ns, stimulus.end_ns)

    def _accept_config(self, fields: tuple[str, ...], config: Config) -> None:
        patch = self._patch_index.get(config.patch)
        if patch is None or fields != (config.patch, str(config.cell)):
            raise ProtocolError(
                f"config for {config.patch}/{config.cell} published on the key of {'/'.join(fields)}"
            )
        if not 0 <= config.cell < self._patches[patch].n_cells:
            n_cells = self._patches[patch].n_cells
            raise ProtocolError(
                f"config for cell {config.cell}: patch {config.patch} has cells 0 to {n_cells - 1}"
            )
        cell = int(self.wiring.first_cell[patch]) + config.cell
        if config.t_ns:
            self._body.count_arrivals()
        else:
            self.counters["external_configs"] += 1
        self._configs.append((config.t_ns, cell, config))

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Do nothing: the body is the only upstream, and its loss is never tolerated."""

    def step(self, put: Put) -> None:
        """Simulate one period and publish its data, topologies and period ends."""
        start_ns = self._period_index * self._period_ns
        end_ns = start_ns + self._period_ns
        self._send_configs(start_ns, end_ns)
        self._sample()
        data, configs = self.network.advance(end_ns)
        for cell, config in configs:
            self._configure(cell, config)
        if end_ns % NS_PER_S < self._period_ns or end_ns + self._period_ns > self._end_ns:
            put(self._counters_key, encode(self._counters_message(end_ns)))
        self._publish(put, data, start_ns, end_ns)
        self._inject_delay(start_ns)
        self._period_index += 1

    def _send_configs(self, start_ns: int, end_ns: int) -> None:
        """Send the configurations that are due in this period from the interfaces to their cells."""
        if not self._configs:
            return
        due = [entry for entry in self._configs if entry[0] < end_ns]
        self._configs = [entry for entry in self._configs if entry[0] >= end_ns]
        for t_ns, cell, config in sorted(due, key=lambda entry: entry[:2]):
            self.network.send_config(max(t_ns, start_ns), cell, config)

    def _sample(self) -> None:
        """Sample all cells; those that are members of the network send their events and readings."""
        start_ns = self._period_index * self._period_ns
        before = self._stimuli.pop(start_ns)
        after = self._stimuli[start_ns + self._period_ns]
        times_ns = self._transducers.sample_times_ns(self._period_index)
        restarted = self.network.take_restarted()
        if len(restarted):
            self._transducers.reset(restarted)
            self._encoder.reset(restarted)
        self._transducers.sample(self._period_index, before, after, self._readings)
        self._sensor_faults.apply(start_ns, times_ns, self._readings)
        heard = self.network.membership.is_member
        if self.network.has_change_before(start_ns + self._period_ns):
            heard = heard & self.network.powered_at(times_ns)
        everyone = bool(heard.all())
        if not everyone:
            self._readings[~heard] = 0.0
        emission = self._encoder.encode(self._readings)
        if not everyone:
            emission = _from_members(emission, heard)
            self._encoder.cancel_repeats(~heard)
        if len(emission.cell) or len(emission.full_cell):
            self.network.send_samples(times_ns, emission, self._readings)
        babble = self._sensor_faults.spurious_events(start_ns, start_ns + self._period_ns)
        if len(babble.cell):
            self.network.send_spurious_events(babble)

    def _inject_delay(self, t_ns: int) -> None:
        """Inject the processing delay of a slow-host fault; results do not change."""
        for span in self._slow_process_faults:
            if span.t_ns <= t_ns < span.until_ns and isinstance(span.rule, SlowProcess):
                time.sleep(span.rule.added_delay_ms * 1e-3)

    def _configure(self, cell: int, config: Config) -> None:
        """Apply a received configuration to a cell; count and ignore an invalid one."""
        try:
            self._encoder.configure(cell, config)
        except ProtocolError as error:
            self.counters["rejected_configs"] += 1
            if self.counters["rejected_configs"] == 1:
                log.warning(
                    "%s/%d rejected an invalid configuration (later ones are only counted): %s",
                    config.patch,
                    config.cell,
                    error,
                )

    def _publish(self, put: Put, data: list[DeliveredPackets], start_ns: int, end_ns: int) -> None:
        streams: dict[int, NDArray[Any]] = {}
        for patch, kind, rows, gateway, t_ns in data:
            rows["cell"] -= rows["cell"].dtype.type(self.wiring.first_cell[patch])
            if kind == PacketKind.EVENT:
                self._publishers[patch].publish_events(put, rows, gateway, t_ns)
            else:
                streams[patch] = rows
        for patch, publisher in enumerate(self._publishers):
            if self.network.membership.topology_version(patch) != publisher.topology_version:
                self._new_topologies.append(
                    publisher.publish_topology(put, self.network.membership.topology_message(patch, end_ns))
                )
            publisher.end_period(put, start_ns, end_ns, streams.get(patch))

    def _counters_message(self, t_ns: int) -> Counters:
        """Return the counters of the network and of this process up to `t_ns`."""
        packets = self.network.counters()
        counts = {f"{kind}.{what}": n for kind, entry in packets.items() for what, n in entry.items()}
        counts["level_repeats"] = self._encoder.level_repeats
        return Counters(process=self.name, t_ns=t_ns, counts=counts | dict(self.counters))

    def best_effort_messages(self) -> list[tuple[str, bytes]]:
        """Return new topologies for best-effort publication, for late-joining subscribers."""
        news, self._new_topologies = self._new_topologies, []
        return news

    def telemetry(self) -> list[tuple[str, bytes]]:
        """Return the link telemetry of all patches."""
        network = self.network
        return self._link_telemetry.messages(
            network.kernel, network.formation_driver.powered, network.kernel.now_ns
        )

    def result(self) -> ProcessResult:
        """Return the counters of the network, its recoveries and the latency histogram."""
        facts = {
            "logs": {publisher.patch: publisher.log_sha256 for publisher in self._publishers},
            "network": self.network.counters(),
            "formation_packets": self.network.formation_driver.sent,
            "formation_retransmitted": self.network.formation_driver.retransmitted,
            "formation_dropped": self.network.formation_driver.dropped_packets,
            "tree_depth": self.network.membership.tree_depth(),
            "formed_ns": self.network.membership.formed_ns_by_patch(),
            "unreachable_cells": sum(
                self.network.membership.n_unreachable(patch) for patch in range(len(self._patches))
            ),
            "unreachable_patches": [
                name for i, name in enumerate(self._patch_index) if self.network.membership.is_unreachable(i)
            ],
            "unpowered_cells": int((~self.network.formation_driver.powered).sum()),
            "recoveries": self._recovery_facts(),
            "level_repeats": self._encoder.level_repeats,
            "latency_max_ns": self.network.demultiplexer.latency_max_ns,
        }
        return ProcessResult(
            self.name, self.role, facts, {"latency_us": self.network.demultiplexer.latency_us}
        )

    def _recovery_facts(self) -> list[dict[str, Any]]:
        first = self.wiring.first_patch
        return [
            asdict(recovery)
            | {
                "patches": [
                    p.name for p in self.wiring.patches[first[recovery.group] : first[recovery.group + 1]]
                ]
            }
            for recovery in self.network.recovery_log.recoveries
        ]


def _from_members(emission: EncoderOutput, is_member: NDArray[np.bool_]) -> EncoderOutput:
    """Return the part of `emission` that comes from cells of the network, by `is_member` (cells,)."""
    heard = is_member[emission.cell]
    columns = [column[heard] for column in emission[:-1]]
    return EncoderOutput._make([*columns, emission.full_cell[is_member[emission.full_cell]]])
