"""Makes the picture of a robot that was only given its skin: `python docs/preview.py OUT.png`.

`skinnet init` on the UR5 model that comes with skinnet, then `skinnet preview`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
_MODEL = ROOT / "skinnet" / "body" / "models" / "ur5.xml"
_WIDTH_PX, _COLOURS = 1100, 256


def main(out: Path) -> None:
    """Write the picture to `out`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ur5.toml"
        skinnet = [sys.executable, "-m", "skinnet.cli"]
        subprocess.run([*skinnet, "init", str(_MODEL), "--out", str(file)], check=True)
        subprocess.run([*skinnet, "preview", str(file), "--out", folder], check=True)
        drawn = Image.open(Path(folder) / "ur5_preview.png").convert("RGB")
        small = drawn.resize((_WIDTH_PX, round(drawn.height * _WIDTH_PX / drawn.width)))
        small.quantize(_COLOURS).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
