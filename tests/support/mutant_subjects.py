"""Subjects of the mutants: modules, and the tests that mirror them."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["SUBJECTS", "Mapping", "modules_of"]


class Mapping(NamedTuple):
    """Modules, and their tests.

    Attributes:
        modules: Patterns of the modules.
        tests: Tests that run compiled.
        as_python: Tests that run first, with all compiled code as plain Python: a mutant that they notice
            need not be compiled. Only small tests are fast enough.
    """

    modules: tuple[str, ...]
    tests: tuple[str, ...] = ()
    as_python: tuple[str, ...] = ()


def _contact(*tests: str) -> tuple[str, ...]:
    """Tests of contact, by the names of their files without `test_`, and of single tests in them."""
    found = []
    for test in tests:
        file, _, name = test.partition("::")
        found.append(f"tests/skinnet/body/contact/test_{file}.py" + f"::test_{name}" * bool(name))
    return tuple(found)


def _modules(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{folder}/{name}.py" for name in names)


_CONTACT = "skinnet/body/contact"
_ONE = "single_evaluations"
_TIP = "cell_loading::a_tip_reads_the_closed_form_wherever_it_presses[0.008-0.03]"
_MOMENT = "cell_loading::the_moment_is_that_of_the_centre_of_pressure"
_RAYS = "parallel_rays"
_SPHERES = "broad_phase::the_sphere_of_a_patch_holds_its_cells_and_little_more"
_THICKNESS = tuple(
    f"thin_links::rays_start_{how}"
    for how in ("before_the_far_face_of_a_link", "in_the_middle_of_a_thin_link")
)
_ROUND_SHEET = "sheet_foundation::a_plate_on_a_round_sheet_is_the_integral_over_the_circle[0.002]"
_TABLE = (
    "foam_curve::a_straight_table_in_series_is_the_linear_law",
    "foam_curve::the_slope_is_the_derivative",
    "foam_curve::no_path_makes_energy",
)
_STATICS = ("skin_foundation", "cell_loading", "sheet_foundation", "contact_scene", "thin_links")

SUBJECTS: dict[str, tuple[Mapping, ...]] = {
    "contact": (
        Mapping(_modules(_CONTACT, "ray_casting"), as_python=_contact("ray_casting")),
        Mapping(
            _modules(_CONTACT, "convex_hull"),
            _contact("convex_hull", "contact_scene"),
            _contact(
                "convex_hull::points_in_a_plane_have_no_hull",
                "convex_hull::a_hull_of_few_vertices_is_mujocos",
            )
            + _contact(
                *(f"convex_hull::rays_agree_with_clipping_by_all_planes[{n}]" for n in ("grid", "few"))
            ),
        ),
        Mapping(
            _modules(_CONTACT, "mesh_quality"),
            as_python=_contact(
                "contact_scene::gap_between_hull_and_mesh_is_that_in_the_middle_of_the_opening",
                "contact_scene::gap_of_a_notch_between_long_triangles",
                "contact_scene::gap_of_a_jagged_mesh_is_that_of_points_all_over_it",
                "contact_scene::open_and_inward_meshes_are_known",
            ),
        ),
        Mapping(
            _modules(_CONTACT, "collision_filter", "contact_margins"),
            _contact("contact_scene"),
            _contact("collision_filter"),
        ),
        Mapping(
            _modules(_CONTACT, "cell_loading", "parallel_rays", "sample_grid", "skin_surface"),
            _contact(*_STATICS),
            _contact(_ONE, _RAYS, _SPHERES, _TIP, _MOMENT, _ROUND_SHEET),
        ),
        Mapping(
            _modules(_CONTACT, "broad_phase", "cell_tree", "contact_scene", "link_thickness"),
            _contact("broad_phase", *_STATICS),
            _contact(
                _ONE,
                *_THICKNESS,
                "broad_phase::every_node_holds_its_cells",
                "broad_phase::only_cells_near_a_solid_are_active",
            ),
        ),
        Mapping(
            _modules(_CONTACT, "winkler", "foam", "skin_foundation", "point_kinematics", "contact_problem"),
            _contact(*_STATICS, "broad_phase", "foam_energy"),
            _contact(_ONE, _MOMENT),
        ),
        Mapping(
            _modules(_CONTACT, "compliant_layer"),
            ("tests/skinnet/body/environment",),
            _contact(_ONE, *_TABLE),
        ),
        Mapping(
            _modules(_CONTACT, "sheet_foundation"),
            _contact("sheet_foundation"),
            _contact(_ROUND_SHEET, "sheet_foundation::depth_times_stiffness_times_area_is_the_force"),
        ),
        Mapping(_modules(_CONTACT, "foam_curve"), _contact("foam_curve"), _contact(*_TABLE)),
        Mapping(
            _modules(_CONTACT, "foam_response", "implicit_step", "joint_coupling", "line_search"),
            _contact("skin_foundation", "foam_energy", "foam_curve", "constraint_rows"),
            _contact(_ONE, "line_search", "constraint_rows::only_what_constraints_couple_to_foam_takes_part"),
        ),
        Mapping(
            _modules(_CONTACT, "constraint_rows"),
            _contact("constraint_rows"),
            _contact("constraint_rows::only_what_constraints_couple_to_foam_takes_part")
            + _contact("constraint_rows::a_cone_in_the_first_row")
            + _contact("constraint_rows::forces_and_their_derivative_are_those_of_mujoco"),
        ),
    ),
    "network": (
        Mapping(("skinnet/network/power_grid.py",), ("tests/skinnet/network/test_power_grid.py",)),
        Mapping(("skinnet/network/packet_ids.py",), ("tests/skinnet/network/test_network_csv.py",)),
        Mapping(("skinnet/network/packet_[!i]*.py",), ("tests/skinnet/network/test_network_kernel.py",)),
        Mapping(
            ("skinnet/network/[kmrt]*.py",),
            ("tests/skinnet/network/test_routes.py", "tests/skinnet/network/test_network_kernel.py"),
        ),
        Mapping(("cells/networking/*.py",), ("tests/cells/networking",)),
    ),
    "sensing": (
        Mapping(("cells/sensing/*.py",), ("tests/cells/sensing",)),
        Mapping(("skinnet/body/stimulus.py",), ("tests/skinnet/body/test_stimulus.py",)),
    ),
    "touch": (Mapping(("controller/touch/*.py",), as_python=("tests/controller/touch",)),),
    "nursing": (Mapping(("controller/nursing/**/*.py",), ("tests/controller/nursing",)),),
    "metrics": (
        Mapping(("skinnet/analysis/metrics/[gnopt]*.py",), ("tests/skinnet/analysis/metrics",)),
        Mapping(("skinnet/body/ground_truth/payload_outcome.py",), ("tests/skinnet/body/test_riba_body.py",)),
        Mapping(
            ("skinnet/body/ground_truth/grasp_outcome.py",),
            (
                "tests/skinnet/body/environment/test_stand.py",
                "tests/skinnet/body/environment/test_objects.py",
            ),
        ),
        Mapping(
            ("skinnet/body/ground_truth/[cm]*.py",),
            ("tests/skinnet/body/ground_truth", "tests/skinnet/body/test_simulation.py"),
        ),
    ),
}
"""Modules and their tests by subject; modules that nothing maps are not mutated."""


def modules_of(root: Path, subject: str) -> Iterator[tuple[Mapping, Path]]:
    """Modules of a subject in order, each with its mapping."""
    for mapping in SUBJECTS[subject]:
        for pattern in mapping.modules:
            for path in sorted(root.glob(pattern)):
                yield mapping, path
