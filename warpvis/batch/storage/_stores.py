# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where datasets are: a folder of this machine or an fsspec URL, read and written through the same few calls."""

from __future__ import annotations

import itertools
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, Protocol

from warpvis.batch.storage._lease import leased, require_unlocked
from warpvis.batch.storage._output import ShardFiles, files_below
from warpvis.batch.storage._sync import sync_folders, sync_tree
from warpvis.core.checks import as_path
from warpvis.errors import FileFormatError

_PART = ".part-"
"""Temporary folders of a dataset begin so: whatever is in them was not finished."""
_LOCK = f"{_PART}lock"
"""Of URLs: who writes the dataset."""


class Store(Protocol):
    """The files of a dataset, by their paths relative to it, with slashes."""

    name: str
    """What messages call it."""

    def read(self, name: str) -> bytes | None:
        """Read what a file holds; None if there is none."""
        ...

    def open(self, name: str) -> IO[bytes]:
        """Open a file to read it."""
        ...

    def size(self, name: str) -> int | None:
        """Count the bytes of a file; None if there is none."""
        ...

    def entries(self) -> list[str]:
        """List the files and folders at the top, without what was not finished."""
        ...

    def names(self, folder: str) -> list[str]:
        """List what a folder holds, without what is in its folders; nothing if there is none."""
        ...

    def files(self) -> Iterator[str]:
        """Go through every file, without what was not finished."""
        ...

    def create(self) -> None:
        """Make the folder if it is missing."""
        ...

    def clean(self) -> None:
        """Remove what was not finished."""
        ...

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        ...

    def locked(self) -> AbstractContextManager[None]:
        """Keep other processes from writing the dataset, within a context; of a folder, those of this machine."""
        ...

    def require_unlocked(self) -> None:
        """Raise a `FileFormatError` if another process is writing the dataset; nothing is written."""
        ...

    def new_files(self) -> AbstractContextManager[ShardFiles]:
        """Make a context with `ShardFiles` in a new temporary folder, which is gone after it."""
        ...

    def put(self, files: ShardFiles, units: Iterable[str]) -> None:
        """Move files and folders of a temporary folder to their places, each as a whole, in this order.

        On a disk of this machine they stay there then, whatever happens to the machine.
        """
        ...


class LocalStore:
    """A folder of this machine. Its temporary folders are inside it, so that moving is renaming."""

    def __init__(self, root: Path) -> None:
        """Take the dataset in the folder `root`, which may be missing."""
        self.root = root.absolute()
        self.name = str(root)
        self._on_disk = {self.root}

    def read(self, name: str) -> bytes | None:
        return None if self.size(name) is None else (self.root / name).read_bytes()

    def open(self, name: str) -> IO[bytes]:
        return (self.root / name).open("rb")

    def size(self, name: str) -> int | None:
        try:
            found = (self.root / name).stat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        return found.st_size if stat.S_ISREG(found.st_mode) else None  # a device or a pipe would be read for ever

    def entries(self) -> list[str]:
        if not self.root.exists():
            return []
        return sorted(name for name in os.listdir(self.root) if not name.startswith(_PART))

    def names(self, folder: str) -> list[str]:
        try:
            return os.listdir(self.root / folder)
        except (FileNotFoundError, NotADirectoryError):
            return []

    def files(self) -> Iterator[str]:
        yield from (name for name in files_below(self.root) if not name.startswith(_PART))

    def create(self) -> None:
        new = [place for place in (self.root, *self.root.parents) if not place.is_dir()]
        self.root.mkdir(parents=True, exist_ok=True)
        sync_folders(place.parent for place in new)

    def clean(self) -> None:
        for path in self.root.glob(f"{_PART}*"):
            shutil.rmtree(path)

    def remove(self, name: str) -> None:
        (self.root / name).unlink(missing_ok=True)
        sync_folders([(self.root / name).parent])

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes of this machine from writing the dataset, within a context.

        Raises:
            FileFormatError: Another one does already.
        """
        try:
            import fcntl
        except ImportError:  # Windows
            yield
            return
        descriptor = os.open(self.root, os.O_RDONLY)
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise FileFormatError(f"{self.name}: another process is writing it; wait for it, or end it") from None
            yield
        finally:
            os.close(descriptor)

    def require_unlocked(self) -> None:
        with self.locked():
            pass

    @contextmanager
    def new_files(self) -> Iterator[ShardFiles]:
        folder = tempfile.mkdtemp(prefix=_PART, dir=self.root)
        try:
            yield ShardFiles(folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def put(self, files: ShardFiles, units: Iterable[str]) -> None:
        changed = set()
        for unit in units:
            sync_tree(files.folder / unit)
            target = self.root / unit
            changed.add(target.parent)
            self._make_folder(target.parent)
            if target.is_dir():  # of an attempt that was not recorded; a folder cannot be renamed over it
                shutil.rmtree(target)
            os.replace(files.folder / unit, target)
        sync_folders(changed)

    def _make_folder(self, folder: Path) -> None:
        """Make a folder, and wait until it is on the disk with those that it is in: another thread may have made it."""
        folder.mkdir(parents=True, exist_ok=True)
        unsure = list(itertools.takewhile(lambda place: place not in self._on_disk, (folder, *folder.parents)))
        sync_folders(place.parent for place in unsure)
        self._on_disk.update(unsure)


class RemoteStore:
    """An fsspec URL. Files are written to a temporary folder of this machine first, and then copied."""

    def __init__(self, url: str) -> None:
        """Open the dataset at `url`.

        Raises:
            FileFormatError: fsspec does not know such URLs, or a package for them is missing.
        """
        try:
            import fsspec
        except ImportError:
            raise FileFormatError(f"{url}: URLs need fsspec: pip install 'warpvis[cluster]'") from None
        try:
            self._system, self._root = fsspec.core.url_to_fs(url)
        except (ImportError, ValueError, OSError) as error:
            raise FileFormatError(f"{url}: cannot be opened: {error}") from None
        self._root = self._root.rstrip("/")
        self.name = url.rstrip("/")

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    def read(self, name: str) -> bytes | None:
        try:
            return self._system.cat_file(self._path(name))
        except (FileNotFoundError, NotADirectoryError):
            return None

    def open(self, name: str) -> IO[bytes]:
        return self._system.open(self._path(name), "rb")

    def size(self, name: str) -> int | None:
        try:
            found = self._system.info(self._path(name))
        except (FileNotFoundError, NotADirectoryError):
            return None
        return found["size"] if found["type"] == "file" else None

    def entries(self) -> list[str]:
        return sorted(self._names(self._root))

    def names(self, folder: str) -> list[str]:
        return self._names(self._path(folder))

    def _names(self, path: str) -> list[str]:
        try:
            found = self._system.ls(path, detail=False)
        except FileNotFoundError:
            return []
        names = [entry.rstrip("/").rsplit("/", 1)[-1] for entry in found]
        return [name for name in names if not name.startswith(_PART)]

    def files(self) -> Iterator[str]:
        names = (path[len(self._root) :].lstrip("/") for path in self._system.find(self._root))
        yield from (name for name in names if not name.startswith(_PART))

    def create(self) -> None:
        self._system.makedirs(self._root, exist_ok=True)

    def clean(self) -> None:
        self._system.invalidate_cache()  # temporary folders are elsewhere

    def remove(self, name: str) -> None:
        with suppress(FileNotFoundError):
            self._system.rm_file(self._path(name))

    def locked(self) -> AbstractContextManager[None]:
        """Keep other processes, of any machine, from writing the dataset, within a context; see `leased`."""
        return leased(self._system, self._path(_LOCK), self.name)

    def require_unlocked(self) -> None:
        require_unlocked(self._system, self._path(_LOCK), self.name)

    @contextmanager
    def new_files(self) -> Iterator[ShardFiles]:
        with tempfile.TemporaryDirectory(prefix="warpvis-") as folder:
            yield ShardFiles(folder)

    def put(self, files: ShardFiles, units: Iterable[str]) -> None:
        for unit in units:
            source = files.folder / unit
            paths = sorted(path for path in source.rglob("*") if path.is_file()) if source.is_dir() else [source]
            for path in paths:
                target = self._path(path.relative_to(files.folder).as_posix())
                self._system.makedirs(target.rsplit("/", 1)[0], exist_ok=True)
                self._system.put_file(str(path), target)


def is_local(out: str | os.PathLike[str]) -> bool:
    """Tell whether a dataset is in a folder of this machine."""
    return "://" not in os.fspath(out).removeprefix("file://")


def open_store(out: str | os.PathLike[str]) -> Store:
    """Open the dataset of a folder, or of an fsspec URL such as ``s3://bucket/name``.

    Raises:
        FileFormatError: It is a file, or a URL that cannot be opened.
    """
    as_path(out, "out")
    text = os.fspath(out)
    if not is_local(text):
        return RemoteStore(text)
    path = as_path(text.removeprefix("file://"), "out")
    there = next((place for place in (path, *path.parents) if place.exists()), path)
    if there.exists() and not there.is_dir():
        raise FileFormatError(f"{there}: is a file; a dataset needs a folder")
    return LocalStore(path)
