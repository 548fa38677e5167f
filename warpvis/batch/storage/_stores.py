# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stores of datasets, local folders and fsspec URLs, with a common interface."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, TypeAlias

from warpvis.batch.storage._lease import leased, require_unlocked
from warpvis.batch.storage._output import ShardFiles, files_below
from warpvis.core.checks import as_path
from warpvis.errors import FileFormatError

_PART = ".part-"
"""Prefix of temporary folders in a dataset; their contents are incomplete."""
_LOCK = f"{_PART}lock"
"""Name of the lock file at a URL."""

# Concurrent calls of fsync share commits of the file system: for 218 files of 26 kB, they take half the time.
_THREADS = 8

_OPEN = os.O_RDONLY if hasattr(os, "O_DIRECTORY") else os.O_RDWR  # Windows requires write access
_UNSUPPORTED = (errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


class LocalStore:
    """The files of a dataset in a local folder; paths are relative to it, with slashes.

    The folder contains its temporary folders, so that moving files is renaming.
    """

    def __init__(self, root: Path) -> None:
        """Open the dataset in the folder `root`, which need not exist."""
        self.root = root.absolute()
        self.name = str(root)
        self._on_disk = {self.root}

    def read(self, name: str) -> bytes | None:
        """Return the contents of a file; None if it does not exist."""
        return None if self.size(name) is None else (self.root / name).read_bytes()

    def open(self, name: str) -> IO[bytes]:
        """Open a file for reading."""
        return (self.root / name).open("rb")

    def size(self, name: str) -> int | None:
        """Return the size of a file in bytes; None if it does not exist."""
        try:
            status = (self.root / name).stat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        return status.st_size if stat.S_ISREG(status.st_mode) else None  # reading a device or a pipe may never end

    def entries(self) -> list[str]:
        """Return the files and folders at the top level, without temporary ones."""
        if not self.root.exists():
            return []
        return sorted(name for name in os.listdir(self.root) if not name.startswith(_PART))

    def names(self, folder: str) -> list[str]:
        """Return the entries of a folder, not recursively; an empty list if it does not exist."""
        try:
            return os.listdir(self.root / folder)
        except (FileNotFoundError, NotADirectoryError):
            return []

    def files(self) -> Iterator[str]:
        """Yield all files, without temporary ones."""
        yield from (name for name in files_below(self.root) if not name.startswith(_PART))

    def create(self) -> None:
        """Create the folder if it is missing."""
        new = [folder for folder in (self.root, *self.root.parents) if not folder.is_dir()]
        self.root.mkdir(parents=True, exist_ok=True)
        sync_folders(folder.parent for folder in new)

    def clean(self) -> None:
        """Remove temporary folders."""
        for path in self.root.glob(f"{_PART}*"):
            shutil.rmtree(path)

    def remove(self, name: str) -> None:
        """Remove a file if it exists."""
        (self.root / name).unlink(missing_ok=True)
        sync_folders([(self.root / name).parent])

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the dataset for writing by other processes of this machine, as a context manager."""
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
                raise FileFormatError(f"{self.name}: another process is writing it. Wait for it, or end it.") from None
            yield
        finally:
            os.close(descriptor)

    def require_unlocked(self) -> None:
        """Raise a `FileFormatError` if another process is writing the dataset; nothing is written."""
        with self.locked():
            pass

    @contextmanager
    def new_files(self) -> Iterator[ShardFiles]:
        """Create `ShardFiles` in a new temporary folder, as a context manager that removes the folder on exit."""
        folder = tempfile.mkdtemp(prefix=_PART, dir=self.root)
        try:
            yield ShardFiles(folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def put(self, files: ShardFiles, units: Iterable[str]) -> None:
        """Move files and folders from a temporary folder to the dataset, each atomically, in this order.

        On a local disk they are synchronized and survive a power failure.
        """
        changed = set()
        for unit in units:
            sync_tree(files.folder / unit)
            target = self.root / unit
            changed.add(target.parent)
            self._make_folder(target.parent)
            if target.is_dir():  # from an attempt without a record; os.replace cannot overwrite a folder
                shutil.rmtree(target)
            os.replace(files.folder / unit, target)
        sync_folders(changed)

    def _make_folder(self, folder: Path) -> None:
        """Create a folder, and synchronize it and its parents, also if another thread has created them."""
        folder.mkdir(parents=True, exist_ok=True)
        unsynced = list(itertools.takewhile(lambda path: path not in self._on_disk, (folder, *folder.parents)))
        sync_folders(path.parent for path in unsynced)
        self._on_disk.update(unsynced)


class RemoteStore:
    """The files of a dataset at an fsspec URL, written to a local temporary folder first, and then copied."""

    def __init__(self, url: str) -> None:
        """Open the dataset at `url`."""
        try:
            import fsspec
        except ImportError:
            raise FileFormatError(f"{url}: URLs require fsspec: pip install 'warpvis[cluster]'") from None
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
            info = self._system.info(self._path(name))
        except (FileNotFoundError, NotADirectoryError):
            return None
        return info["size"] if info["type"] == "file" else None

    def entries(self) -> list[str]:
        return sorted(self._names(self._root))

    def names(self, folder: str) -> list[str]:
        return self._names(self._path(folder))

    def _names(self, path: str) -> list[str]:
        try:
            entries = self._system.ls(path, detail=False)
        except FileNotFoundError:
            return []
        names = [entry.rstrip("/").rsplit("/", 1)[-1] for entry in entries]
        return [name for name in names if not name.startswith(_PART)]

    def files(self) -> Iterator[str]:
        names = (path[len(self._root) :].lstrip("/") for path in self._system.find(self._root))
        yield from (name for name in names if not name.startswith(_PART))

    def create(self) -> None:
        self._system.makedirs(self._root, exist_ok=True)

    def clean(self) -> None:
        self._system.invalidate_cache()  # temporary folders are local and removed by their context managers

    def remove(self, name: str) -> None:
        with suppress(FileNotFoundError):
            self._system.rm_file(self._path(name))

    def locked(self) -> AbstractContextManager[None]:
        """Lock the dataset for writing by other processes on any machine, as a context manager; see `leased`."""
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


Store: TypeAlias = LocalStore | RemoteStore
"""The files of a dataset."""


def is_local(out: str | os.PathLike[str]) -> bool:
    """Return whether a dataset is a local folder."""
    return "://" not in os.fspath(out).removeprefix("file://")


def open_store(out: str | os.PathLike[str]) -> Store:
    """Open the dataset in a folder, or at an fsspec URL such as ``s3://bucket/name``."""
    as_path(out, "out")
    text = os.fspath(out)
    if not is_local(text):
        return RemoteStore(text)
    path = as_path(text.removeprefix("file://"), "out")
    existing = next((folder for folder in (path, *path.parents) if folder.exists()), path)
    if existing.exists() and not existing.is_dir():
        raise FileFormatError(f"{existing}: is a file, but a dataset must be a folder")
    return LocalStore(path)


def sync_tree(path: Path) -> None:
    """Synchronize a file, or a folder with all its contents."""
    if not path.is_dir():
        _sync(path)
        return
    folders = list(os.walk(path))
    files = [os.path.join(folder, name) for folder, _, names in folders for name in names]
    with ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(_sync_all, (files[first::_THREADS] for first in range(min(_THREADS, len(files))))))
    sync_folders(folder for folder, _, _ in folders)


def sync_folders(folders: Iterable[str | os.PathLike[str]]) -> None:
    """Synchronize the entries of folders."""
    if hasattr(os, "O_DIRECTORY"):  # Windows cannot open folders
        for folder in folders:
            _sync(folder)


def _sync_all(paths: Iterable[str]) -> None:
    for path in paths:
        _sync(path)


def _sync(path: str | os.PathLike[str]) -> None:
    descriptor = os.open(path, _OPEN)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:  # the file system does not support fsync
            raise
    finally:
        os.close(descriptor)
