"""Draw twelve of the bundled frames, evenly spread over the data set, for the README.

Run with `make readme-figure`; writes book/images/samples.jpg.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from hadr.data.samples import open_samples

COLUMNS, ROWS, WIDTH, HEIGHT = 4, 3, 320, 180
OUT = Path(__file__).parent / "images" / "samples.jpg"


def main() -> None:
    """Draw the sheet."""
    frames = [(split, i) for split in ("train", "val", "test") for i in range(len(SPLITS[split]))]
    frames.sort(key=lambda f: SPLITS[f[0]].files[f[1]].stem)
    # A step that shares no factor with the eight objects: all of them appear.
    chosen = [frames[i * 41 % len(frames)] for i in range(COLUMNS * ROWS)]
    tiles = [
        cv2.resize(SPLITS[split][i].color, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        for split, i in chosen
    ]
    rows = [np.hstack(tiles[r * COLUMNS : (r + 1) * COLUMNS]) for r in range(ROWS)]
    sheet = np.vstack(rows)[..., ::-1]
    cv2.imwrite(str(OUT), np.ascontiguousarray(sheet), [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(OUT.name, f"{OUT.stat().st_size / 1e3:.0f} kB")


SPLITS = {name: open_samples(name) for name in ("train", "val", "test")}

if __name__ == "__main__":
    main()
