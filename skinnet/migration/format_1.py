"""Vocabulary of format 1: names of keys, values, messages and metrics, and what they are called now.

Data only. Paths of deployment keys are those of format 1: `[]` is an entry of a list, `*` any name in a
table.
"""

from collections.abc import Mapping
from types import MappingProxyType

__all__ = [
    "CHANNEL_KEYS",
    "COUNTERS",
    "DEPLOYMENT_KEYS",
    "DEPLOYMENT_VALUES",
    "ENCODINGS",
    "ENCODING_METRIC",
    "FAULT_KINDS",
    "MESSAGE_FIELDS",
    "MESSAGE_TYPES",
    "METRICS",
    "PARAMETERS",
    "POINT",
    "PROCESS_FAILURE_KEYS",
    "STAGE_KINDS",
    "STRESS_METRICS",
    "SUMMARY_KEYS",
]

DEPLOYMENT_KEYS: Mapping[str, str] = MappingProxyType(
    {
        "hosts": "cell_processes",
        "run.may_be_lost": "tolerated_losses",
        "body.reference": "reference_body",
        "body.physics_ms": "timestep_ms",
        "body.stimulus_ms": "stimulus_period_ms",
        "body.joints_ms": "joint_state_period_ms",
        "cells.reaction_us": "processing_delay_us",
        "cells.proximity.reach_m": "range_m",
        "cells.proximity.reading_at_reach": "reading_at_range",
        "network.detect_us": "failure_detection_us",
        "network.bundle": "aggregate_events",
        "sheets[].middle_xi_m": "centre_xi_m",
        "sheets[].joins_gaps": "connect_across_gaps",
        "boards.compute_us": "processing_delay_us",
        "boards.pattern_every": "pattern_interval_scans",
        "boards.pressure.element_us": "element_read_us",
        "boards.regions.on_kpa": "activation_kpa",
        "boards.regions.off_kpa": "deactivation_kpa",
        "boards.regions.follow_m": "association_distance_m",
        "board_network.delay_us": "propagation_delay_us",
        "board_network.head_bytes": "header_bytes",
        "power.minimum_v": "brown_out_v",
        "plan.stimulated": "stimulated_fraction",
        "plan.events_hz": "event_rate_hz",
        "plan.idle_events_hz": "idle_event_rate_hz",
        "plan.streams_when_touched": "stream_when_touched",
        "plan.latency_ms": "max_latency_ms",
        "plan.utilisation": "max_utilisation",
        "plan.voltage_v": "min_voltage_v",
        "faults[].per_s": "rate_per_s",
        "faults[].packets_per_s": "rate_hz",
        "faults[].rate": "bit_error_rate",
        "faults[].extra_ms": "added_delay_ms",
        "script": "scripted_stimuli",
        "script.stimulated": "stimulated_fraction",
        "script.stimulation": "random_presses",
        "script.stimulation.unevenness": "force_spread",
        "script.stimulation.stagger_s": "onset_spread_s",
        "script.touches": "presses",
        "script.touches[].unevenness": "force_spread",
        "script.touches[].every_s": "period_s",
        "teacher.lessons[].goals[].at_m": "position_m",
        "teacher.lessons[].gap_m": "clearance_m",
        "teacher.lessons[].speed_m_s": "max_speed_m_s",
        "teacher.lessons[].patience_s": "timeout_s",
        "payload.closing": "closing_joints",
        "payload.closing_rad_s": "closing_speed_rad_s",
        "payload.grip_n": "grip_force_n",
        "payload.release_s": "release_delay_s",
        "payload.easing_s": "release_ramp_s",
        "payload.fallen_m": "drop_threshold_m",
        "stand.near_x_m": "object_face_x_m",
        "stand.offset_m": "max_offset_m",
        "stand.yaw_deg": "max_yaw_deg",
        "stand.stuck": "fix_object",
        "stand.below_m": "rise_m",
        "stand.present_stage": "rise_stage",
        "stand.present_s": "rise_delay_s",
        "stand.lower_s": "lower_delay_s",
        "stand.away_s": "lowered_s",
        "stand.plate_near_x_m": "plate_edge_x_m",
        "nursing.assumed": "assumed_contacts",
        "nursing.object_m": "object_centre_m",
        "nursing.speed_rad_s": "max_joint_speed_rad_s",
        "nursing.acceleration_rad_s2": "max_joint_acceleration_rad_s2",
        "nursing.contact_n": "contact_threshold_n",
        "nursing.follow_m": "association_distance_m",
        "nursing.lost_ms": "contact_timeout_ms",
        "nursing.silent_ms": "skin_timeout_ms",
        "nursing.comfort_kpa": "max_pressure_kpa",
        "nursing.reach_m": "position_tolerance_m",
        "nursing.reach_rad": "rotation_tolerance_rad",
        "nursing.mobility": "min_mobility",
        "controller.stages.*.accuracy_rad": "tolerance_rad",
        "controller.structure.average_s": "averaging_s",
        "controller.map.cut": "min_row_norm",
        "controller.session": "teach_and_grasp",
        "controller.session.operator": "operator_requests",
        "controller.session.operator[].after_s": "delay_s",
        "controller.session.operator[].quiet_s": "contact_free_s",
        "controller.session.patience_s": "operator_timeout_s",
        "controller.session.lost_ms": "contact_timeout_ms",
        "controller.session.stall_ms": "stall_timeout_ms",
        "controller.session.set_down_s": "set_down_delay_s",
        "controller.session.least_skin": "min_skin_fraction",
        "controller.session.states.*.accuracy_rad": "tolerance_rad",
        "controller.session.states.*.patience_s": "timeout_s",
        "controller.outside_velocity": "external_velocity",
        "controller.safety.joint_speed_rad_s": "max_joint_speed_rad_s",
        "controller.safety.stale_ms": "input_timeout_ms",
        "stress.stimulated": "stimulated_fractions",
        "stress.delta_sigmas": "delta_noise_ratios",
        "stress.settle_s": "warm_up_s",
        "stress.published[].share": "fraction",
        "stress.published[].of": "quantity",
        "stress.published[].at_most": "is_upper_bound",
    }
)
"""New name of a deployment key by its old path."""

ENCODINGS: Mapping[str, str] = MappingProxyType(
    {"levels": "level_crossing", "delta": "send_on_delta", "clock": "periodic"}
)
STAGE_KINDS: Mapping[str, str] = MappingProxyType({"session": "teach_and_grasp", "listen": "passive"})
FAULT_KINDS: Mapping[str, str] = MappingProxyType(
    {"babble": "babbling_idiot", "slow_host": "slow_process", "stuck": "stuck_at"}
)
DEPLOYMENT_VALUES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "cells.encoding.kind": ENCODINGS,
        "plan.encoding": ENCODINGS,
        "stress.encodings[]": ENCODINGS,
        "controller.stages.*.kind": STAGE_KINDS,
        "faults[].kind": FAULT_KINDS,
    }
)
"""New value of a deployment key by its old path and its old value."""

CHANNEL_KEYS: tuple[tuple[str, str], ...] = (
    (r"body/world", r"body/free_bodies"),
    (r"skin/([^/]+)/frame", r"skin/\1/period_end"),
    (r"controller/machine", r"controller/state_machine"),
    (r"host/([^/]+)/counters", r"process/\1/counters"),
)
"""Keys below `skinnet/<robot>/` as a pattern, and what they are now."""

MESSAGE_TYPES: Mapping[str, str] = MappingProxyType(
    {
        "skin_frame": "period_end",
        "world": "free_body_poses",
        "machine": "state_machine_description",
        "fault": "fault_event",
        "deployed": "deployment_info",
    }
)
"""New tag of a message by its old one."""

_WATERMARK = {"covered_ns": "watermark_ns"}
MESSAGE_FIELDS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "stimulus": _WATERMARK | {"host": "process", "configs": "n_configs"},
        "pressures": _WATERMARK,
        "joints": _WATERMARK,
        "command": _WATERMARK | {"configs": "config_counts"},
        "stream": _WATERMARK | {"events": "n_events"},
        "skin_frame": _WATERMARK | {"events": "n_events"},
        "regions": _WATERMARK,
        "world": _WATERMARK,
        "topology": {"bridged": "bridged_neighbours"},
        "config": {"pattern_every": "pattern_interval_scans"},
        "answer": {"why": "reason"},
        "machine": {"moves": "transitions"},
        "counters": {"host": "process"},
        "link_load": {"dark": "unpowered_cells"},
        "deployed": {"base": "base_folder"},
    }
)
"""New name of a field by the old tag of its message and its old name."""

COUNTERS: Mapping[str, str] = MappingProxyType(
    {
        "late_frames": "deadline_misses",
        "malformed": "malformed_messages",
        "malformed_envelopes": "malformed_batches",
        "configs_from_outside": "external_configs",
        "requests_from_outside": "external_requests",
        "velocities_from_outside": "external_velocities",
        "refused_configs": "rejected_configs",
    }
)
"""New name of a counter of a process."""

PARAMETERS: Mapping[str, str] = MappingProxyType({"accuracy_rad": "tolerance_rad", "patience_s": "timeout_s"})
"""New last part of the name of a parameter in long-term memory."""

SUMMARY_KEYS: Mapping[str, str] = MappingProxyType(
    {"figures": "metrics", "late_frames": "deadline_misses", "faults": "process_failures"}
)
"""New name of a key of a summary."""
PROCESS_FAILURE_KEYS: Mapping[str, str] = MappingProxyType({"what": "cause"})
"""New name of a key of a process failure in a summary."""

METRICS: tuple[tuple[str, str], ...] = (
    (r"grasp\.peak_reading_told", r"grasp.peak_reading_received"),
    (r"grasp\.ends_in", r"grasp.final_state"),
    (r"grasp\.begin_s\.(.*)", r"grasp.start_s.\1"),
    (r"object\.sunk_mm", r"object.max_descent_mm"),
    (r"object\.placed_m", r"object.initial_position_m"),
    (r"object\.moved_m", r"object.displacement_m"),
    (r"object\.bare\.(.*)_n", r"object.bare_link.\1.peak_force_n"),
    (r"object\.bare\.(.*)_s", r"object.bare_link.\1.contact_s"),
    (r"session\.(.*)", r"teach_and_grasp.\1"),
    (r"recovery\.back_ms\.max", r"recovery.rejoin_ms.max"),
    (r"recovery\.changes", r"recovery.count"),
    (r"formation\.sim_ms", r"formation.duration_ms"),
    (r"structure\.sim_s", r"structure.duration_s"),
    (r"smm\.cells_cut", r"smm.excluded_cells"),
    (r"lessons\.nearest_mm", r"lessons.min_distance_mm"),
    (r"strokes\.missed", r"strokes.missed_cells"),
    (r"strokes\.others", r"strokes.unintended_cells"),
    (r"strokes\.cells", r"strokes.touched_cells"),
    (r"recording\.messages\.frame", r"recording.messages.period_end"),
    (r"recording\.messages\.machine", r"recording.messages.state_machine"),
    (r"recording\.messages\.world", r"recording.messages.free_bodies"),
    (r"plan\.lowest_v", r"plan.min_voltage_v"),
    (r"plan\.browned_out", r"plan.browned_out_cells"),
)
"""Names of metrics of a run as a pattern, and what they are now."""
STRESS_METRICS: tuple[tuple[str, str], ...] = (
    (r"(.*\.)?share\.(packets|bytes)", r"\1fraction.\2"),
    (r"(published\..*)\.share", r"\1.fraction"),
    (r"(c\d+-[^.].*)\.malformed", r"\1.malformed_messages"),
)
"""Names of metrics of a sweep as a pattern; names of points in them are translated beside (`POINT`)."""
POINT = r"(c\d+-)(levels|delta|clock)((?:-.*)?)"
"""Name of a point of a sweep: cells, encoding, and what else it sets."""
ENCODING_METRIC = r"(levels|delta|clock)(\.(?:un)?stimulated\..*)"
"""Name of a metric of the largest points of a sweep: encoding, stimulation, metric."""
