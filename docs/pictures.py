"""Makes the pictures of README.md and docs/ anew: `python docs/pictures.py`, or those named after it.

`docs/images/pictures.toml` says what makes each. Runs go to `runs/pictures/`, one for all pictures that
come from it, each with its report; what the report shows is what the pages get.
"""

import argparse
import io
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from PIL import Image

from skinnet.analysis.report.pictures import read_pictures
from skinnet.files import write_bytes
from skinnet.recording.format import FILE_NAME

__all__ = ["MANIFEST", "Drawn", "Entry", "Script", "make", "read"]

ROOT = Path(__file__).parents[1]
MANIFEST = ROOT / "docs" / "images" / "pictures.toml"
_COLOURS = 256


class Made(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """A picture of what a command of skinnet leaves in its folder."""

    deployment: str
    options: tuple[str, ...] = ()
    width_px: Annotated[int, Meta(gt=0)] | None = None

    @property
    def command(self) -> tuple[str, ...]:
        """What makes the folder, without where it is to be."""
        kind = str(self.__struct_config__.tag)
        return ("skinnet", kind, f"deployments/{self.deployment}.toml", *self.options)


class View(Made, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="view"):
    """The live page of the recording of a run."""

    at_s: Annotated[float, Meta(ge=0.0)]
    tab: str
    modality: str = "force"
    size_px: tuple[int, int] = (1360, 780)

    @property
    def command(self) -> tuple[str, ...]:
        """What makes the recording, without where it is to be."""
        return ("skinnet", "run", f"deployments/{self.deployment}.toml", *self.options, "--record")


class Drawn(Made, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A picture that the command draws itself."""

    picture: str


class Run(Drawn, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="run"):
    """Of `skinnet run`."""


class Plan(Drawn, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="plan"):
    """Of `skinnet plan`."""


class Stress(Drawn, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="stress"):
    """Of `skinnet stress`."""


class Script(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="script"):
    """A picture that a command writes to its place."""

    command: str


Entry = Run | Plan | Stress | View | Script


def read(manifest: Path) -> dict[str, Entry]:
    """What makes each picture, by its name."""
    return msgspec.toml.decode(manifest.read_bytes(), type=dict[str, Entry])


def make(entries: dict[str, Entry], images: Path, work: Path, say: Callable[[str], None]) -> None:
    """Writes every picture of `entries` into `images`; the folders of runs go below `work`."""
    for script in [entry for entry in entries.values() if isinstance(entry, Script)]:
        say(script.command)
        _call(shlex.split(script.command))
    results = {name: entry for name, entry in entries.items() if isinstance(entry, Made)}
    for command in dict.fromkeys(entry.command for entry in results.values()):
        say(shlex.join(command))
        mine = {name: entry for name, entry in results.items() if entry.command == command}
        folder = work / next(iter(mine))
        shutil.rmtree(folder, ignore_errors=True)
        _call([*command, "--out", str(folder)])
        if command[1] != "plan":
            _call(["skinnet", "report", str(folder)])
        drawn = {name: entry for name, entry in mine.items() if isinstance(entry, Drawn)}
        views = {name: entry for name, entry in mine.items() if isinstance(entry, View)}
        for name, data in (*_drawn(drawn, folder), *_viewed(views, folder / FILE_NAME)):
            write_bytes(images / f"{name}.png", _scaled(data, mine[name].width_px))


def _drawn(entries: dict[str, Drawn], folder: Path) -> Iterator[tuple[str, bytes]]:
    shown = {picture.name: picture.data for picture in read_pictures(folder)[0]}
    for name, entry in entries.items():
        if entry.picture not in shown:
            made = shlex.join(entry.command)
            sys.exit(f"{name}: {made} drew no {entry.picture}.png; it drew {', '.join(shown)}")
        yield name, shown[entry.picture]


def _viewed(entries: dict[str, View], recording: Path) -> Iterable[tuple[str, bytes]]:
    if not entries:
        return ()
    screenshots = runpy.run_path(str(Path(__file__).with_name("screenshots.py")))
    shots = [screenshots["Shot"](e.at_s, e.tab, e.modality, e.size_px) for e in entries.values()]
    return zip(entries, screenshots["take"](recording, shots), strict=True)


def _call(command: Iterable[str]) -> None:
    """Runs a command with this Python; ends with it if it fails."""
    program, *arguments = command
    python = [sys.executable] if program == "python" else [sys.executable, "-m", "skinnet.cli"]
    done = subprocess.run([*python, *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, check=False)
    if done.returncode:
        sys.exit(f"{shlex.join([program, *arguments])} failed with exit code {done.returncode}")


def _scaled(data: bytes, width_px: int | None) -> bytes:
    if width_px is None:
        return data
    image = Image.open(io.BytesIO(data)).convert("RGB")
    if image.width > width_px:
        image = image.resize(
            (width_px, round(image.height * width_px / image.width)), Image.Resampling.LANCZOS
        )
    out = io.BytesIO()
    image.quantize(_COLOURS, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> None:
    """The pictures that are named on the command line, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="names in docs/images/pictures.toml; all unless given")
    names = parser.parse_args().names
    entries = read(MANIFEST)
    if unknown := [name for name in names if name not in entries]:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(entries)}")
    chosen = {name: entry for name, entry in entries.items() if not names or name in names}
    make(chosen, MANIFEST.parent, ROOT / "runs" / "pictures", _say)


if __name__ == "__main__":
    main()
