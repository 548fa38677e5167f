# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read texts, JSON and YAML with uniform errors, and detect git-lfs pointers, web pages and images."""

from __future__ import annotations

import contextlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.core.types import Json

_OPENCV_DIRECTIVE = "%YAML:1.0"
_GIT_LFS = b"version https://git-lfs.github.com/spec/"
_PAGES = (b"<!doctype html", b"<html")
_IMAGES = {
    b"\x89PNG\r\n\x1a\n": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"II*\x00": "a TIFF image",
    b"MM\x00*": "a TIFF image",
}
_HEAD = 512
"""Number of bytes that identify the content of a file."""


def require_content(source: Path | bytes, expected: str, *, name: object = None, images: bool = True) -> None:
    """Reject a file that contains a git-lfs pointer, an HTML page or an image instead of the expected content.

    Args:
        source: A file, or its bytes. Unreadable files are not reported here, but by their reader.
        expected: Expected content, such as "a mesh".
        name: Name of the file in error messages; its path by default.
        images: Whether images are rejected, too.
    """
    head, name = _head(source), source if name is None else name
    if head.startswith(_GIT_LFS):
        raise FileFormatError(f"{name}: is a git-lfs pointer, not {expected}. Run `git lfs pull`.")
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if text.startswith(_PAGES) or (text.startswith(b"<?xml") and any(page in text for page in _PAGES)):
        raise FileFormatError(f"{name}: is an HTML page, not {expected}. Download the file that the page shows.")
    image = next((kind for magic, kind in _IMAGES.items() if images and head.startswith(magic)), None)
    if image is not None:
        raise FileFormatError(f"{name}: is {image}, not {expected}")


@contextlib.contextmanager
def reading(path: object, kind: str) -> Iterator[None]:
    """Raise a FileFormatError that names the file for any exception of its reader, since damaged files raise any."""
    try:
        yield
    except FileFormatError:
        raise
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or describe_exception(error)}") from None
    except Exception as error:
        raise FileFormatError(f"{path}: cannot be read as {kind}: {describe_exception(error)}") from None


@contextlib.contextmanager
def writing(path: object) -> Iterator[None]:
    """Raise a FileFormatError that names the file if it cannot be written."""
    try:
        yield
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from None


def read_text(path: Path, kind: str) -> str:
    """Read a UTF-8 text, with or without a byte order mark, of a kind such as "a JSON text file"."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not {kind}") from None


def require_package(module: str, purpose: str, extra: str) -> Any:
    """Import and return a package of an extra; raise a FileFormatError with its purpose if it is missing."""
    try:
        __import__(module)
    except ImportError:
        raise FileFormatError(f"{purpose}, which is missing: pip install 'warpvis[{extra}]'") from None
    return sys.modules[module]


def is_file(path: Path) -> bool:
    """Return whether a file with this name exists. The name may be too long, or contain a zero byte."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _head(source: Path | bytes) -> bytes:
    if isinstance(source, bytes):
        return source[:_HEAD]
    try:
        with source.open("rb") as file:
            return file.read(_HEAD)
    except (OSError, ValueError):  # ValueError: for invalid file names
        return b""


def read_json(path: Path) -> Json:
    """Read a JSON file."""
    text = read_text(path, "a JSON text file")
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: cannot be read as JSON: it is nested too deeply") from None
    except ValueError as error:  # an integer with thousands of digits
        raise FileFormatError(f"{path}: cannot be read as JSON: {error}") from None


def load_yaml(path: Path) -> object:
    """Return the contents of a YAML file: mappings, lists, strings and numbers."""
    try:
        from ruamel.yaml import YAML
    except ImportError:
        raise FileFormatError(f"{path}: reading YAML requires ruamel.yaml: pip install 'warpvis[ros]'") from None
    try:
        # OpenCV's files begin with a directive that is not valid YAML, and use a nonstandard tag. OpenCV also accepts
        # keys without a space after the colon, which files of ORB-SLAM2 have.
        text = path.read_text(encoding="utf-8-sig").replace("!!opencv-matrix", "")
        if text.startswith(_OPENCV_DIRECTIVE):
            text = re.sub(r"^( *[A-Za-z][\w.]*):(?=[^\s/])", r"\1: ", text.removeprefix(_OPENCV_DIRECTIVE), flags=re.M)
        return YAML(typ="safe", pure=True).load(text)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # ruamel.yaml may raise any exception for malformed files
        raise FileFormatError(f"{path}: is not YAML: {describe_exception(error)}") from None
