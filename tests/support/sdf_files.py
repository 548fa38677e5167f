"""SDF files for tests."""

import warnings

import numpy as np
from PIL import Image

import warpvis as wv
from warpvis.io import read_parts


def world(body, version="1.9"):
    return f'<?xml version="1.0"?><sdf version="{version}"><world name="w">{body}</world></sdf>'


def model(body, name="m", version="1.9", more=""):
    return f'<sdf version="{version}"><model name="{name}" {more}>{body}</model></sdf>'


def visual(shape, name="v", more=""):
    return f'<visual name="{name}">{more}<geometry>{shape}</geometry></visual>'


BOX = "<box><size>1 2 3</size></box>"
BOX_LINK = f'<link name="l">{visual(BOX)}</link>'


def write(folder, text, name="file.sdf"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def read(folder, text, name="file.sdf", **options):
    """Return the parts of a file, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_parts(write(folder, text, name), **options)
    assert not found.warnings, found.warnings
    return found


def load(folder, text, name="file.sdf", **options):
    """Return the scene of a file, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(write(folder, text, name), **options)


def only(found):
    """Return the only part."""
    (part,) = found.parts
    return part


def image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.asarray(pixels, dtype=np.uint8)).save(path)
    return path


def model_folder(folder, name, text, *, config=None):
    """Write a model's folder, with a model.config that names model.sdf."""
    write(folder / name, text, "model.sdf")
    config = config or f'<model><name>{name}</name><sdf version="1.9">model.sdf</sdf></model>'
    return write(folder / name, config, "model.config")
