# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small scenes of public datasets, and their readers, for `fuzz_files`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from fuzz_scene_seeds import Item, see

import warpvis as wv


def _item(kind: str, write: Callable[[Path], Path], *, changed: tuple[str, ...] = ()) -> Item:
    """Return the files that a function writes to a folder, and the reader of the one that it returns."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write(folder / "data").relative_to(folder)
        files = {
            str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()
        }
    place = path / "scene_gt.json" if kind == "BOP" else path
    chosen = changed or tuple(name for name in files if not name.endswith((".glb", ".csv")) or kind == "HM3D")
    return kind, files, chosen, lambda root: see(wv.Scene.load(root / place))


def datasets(root: Path) -> Iterator[Item]:
    from support import scans
    from support.bop_scene import write_identity
    from support.habitat import make_dataset

    def house(folder: Path) -> Path:
        items = [{"template_name": name, "rotation": [1, 0, 0, 0], "uniform_scale": 2.0} for name in ("cup", "table")]
        scene = {"stage_instance": {"template_name": "room"}, "object_instances": items, "default_lighting": "x"}
        lights = {"lights": {"a": {"position": [1, 2, 3], "intensity": 2}, "b": {"direction": [0, 1, 0]}}}
        return make_dataset(folder, scene, **{"lights__a__x.lighting_config.json": lights})

    yield _item("Habitat", house)
    for write in (scans.write_scannet, scans.write_scannetpp, scans.write_replica):
        yield _item("scan", write)
    for write in (scans.write_matterport, scans.write_region):
        yield _item("scan", write)
    yield _item("HM3D", scans.write_hm3d)
    yield _item("BOP", write_identity)
    yield _item("GeoTIFF", _terrain)


def _terrain(folder: Path) -> Path:
    import rasterio

    folder.mkdir(parents=True)
    place = {"crs": "EPSG:32633", "transform": rasterio.transform.from_origin(5e5, 5e6, 10, 10)}
    profile = {"driver": "GTiff", "width": 6, "height": 5, "count": 1, "dtype": "float32", "nodata": -1, **place}
    with rasterio.open(folder / "dem.tif", "w", **profile) as file:
        file.write(np.arange(-1, 29, dtype=np.float32).reshape(1, 5, 6))
    return folder / "dem.tif"


MAKERS = (datasets,)
