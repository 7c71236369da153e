"""Files of ROS packages: meshes that a URDF names as `package://NAME/PATH`, found in folders of packages.

A package is a folder with a `package.xml`; its name is that of the manifest, or of the folder.
"""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco

from skinnet.errors import ModelError

__all__ = ["package_folders", "resolve_meshes"]

_MANIFEST = "package.xml"
_VARIABLE = "ROS_PACKAGE_PATH"
_PACKAGE, _FILE = "package://", "file://"
_MANIFEST_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_MESH_KINDS = (".stl", ".obj", ".msh")
"""Kinds of mesh files that MuJoCo reads."""


def resolve_meshes(spec: mujoco.MjSpec, model: Path, package_paths: Sequence[Path]) -> None:
    """Replace `package://` and `file://` in the meshes of a specification by the paths of their files.

    Args:
        spec: The model, as read.
        model: Its file, above which packages are looked for.
        package_paths: Folders of packages, looked at first.

    Raises:
        ModelError: a file is missing, or of a kind that MuJoCo does not read; the text says where it looked.
    """
    for mesh in spec.meshes:
        if not mesh.file.startswith((_PACKAGE, _FILE)):
            continue
        if Path(mesh.file).suffix.lower() not in _MESH_KINDS:
            raise ModelError(
                f"{model}: mesh {mesh.file}: MuJoCo reads {', '.join(_MESH_KINDS)}; convert it to one of them"
            )
        mesh.file = str(_find(mesh.file, model, package_paths))


def package_folders(spec: mujoco.MjSpec, model: Path, package_paths: Sequence[Path]) -> list[Path]:
    """Folders that hold the packages of the meshes and that one would not find from the model's place.

    They are what a deployment has to name, so that it does not depend on the environment; ascending.
    """
    found = set()
    for mesh in spec.meshes:
        if mesh.file.startswith(_PACKAGE):
            file = _find(mesh.file, model, package_paths)
            package, _, inside = mesh.file.removeprefix(_PACKAGE).partition("/")
            if file not in [folder / inside for folder in _packages(package, _above(model))]:
                found.add(file.parents[len(Path(inside).parts) - 1].parent)
    return sorted(found)


def _find(uri: str, model: Path, package_paths: Sequence[Path]) -> Path:
    if uri.startswith(_FILE):
        if (file := Path(uri.removeprefix(_FILE))).is_file():
            return file.resolve()
        raise ModelError(f"{model}: mesh {uri}: there is no file {file}")
    package, _, inside = uri.removeprefix(_PACKAGE).partition("/")
    named = [Path(entry) for entry in os.environ.get(_VARIABLE, "").split(os.pathsep) if entry]
    places = [*package_paths, *_above(model), *named]
    for folder in _packages(package, places):
        if (folder / inside).is_file():
            return (folder / inside).resolve()
    looked = ", ".join(dict.fromkeys(str(place) for place in places)) or "no folder"
    raise ModelError(
        f"{model}: mesh {uri}: not found; looked for package {package} in {looked}; name the folder that has "
        f"it by --package-path (body.package_paths), or {_VARIABLE}"
    )


def _above(model: Path) -> list[Path]:
    """Packages that the model lies in, and the folders that hold them and so their neighbours."""
    inside = [folder for folder in model.resolve().parents if (folder / _MANIFEST).is_file()]
    return [*inside, *(folder.parent for folder in inside)]


def _packages(name: str, places: Sequence[Path]) -> Iterator[Path]:
    """Folders of the package `name`: each place itself, what lies in it, and one level further down."""
    for place in places:
        if place.name == name or _manifest_name(place) == name:
            yield place
        yield place / name
        yield from sorted(place.glob(f"*/{name}"))


def _manifest_name(folder: Path) -> str | None:
    try:
        found = _MANIFEST_NAME.search((folder / _MANIFEST).read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return None
    return found[1] if found else None
