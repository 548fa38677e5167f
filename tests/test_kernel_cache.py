# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels by one of many processes, and interruption by Ctrl-C."""

import ast
import logging
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import warp as wp
from filelock import FileLock

from warpvis.core import kernel_cache
from warpvis.core.kernel_cache import load_module
from warpvis.kernels.poses import poses_to_opencv

PACKAGE = Path(__file__).parent.parent / "warpvis"

# A module with one small kernel takes the same path to the cache in less time.
TINY = """
import warp as wp
@wp.kernel(enable_backward=False)
def tiny(numbers_out: wp.array[wp.int32]):
    numbers_out[wp.tid()] = 1
"""
COLD = """
import logging
logging.basicConfig(level=logging.INFO, format="%(message)s")
from warpvis.core.kernel_cache import init_warp, load_module
import tiny
tiny.wp.config.use_precompiled_headers = False  # they are made for many modules, in seconds
init_warp()
load_module(tiny.tiny)
"""
COMPILED = "compiled kernels of tiny for cpu in "
WAITING = "waiting for another process to compile the kernels"


@pytest.fixture(autouse=True)
def warp_has_started():
    kernel_cache.init_warp()  # tests restore the cache directory, which is unset before Warp starts


@pytest.fixture
def start(tmp_path):
    (tmp_path / "tiny.py").write_text(TINY)

    def start(code=COLD, **environment):
        command = [sys.executable, "-u", "-c", code]
        path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
        environment = os.environ | {"PYTHONPATH": path} | environment
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)

    return start


def logged(process):
    text = process.communicate()[1]
    assert process.returncode == 0, text
    return text


def objects(folder):
    return list(Path(folder).glob("**/wp_tiny*/*.o"))


@pytest.mark.slow
def test_one_of_six_processes_compiles_after_lock_holder_dies(start, tmp_path):
    folder = tmp_path / wp.config.version / "warpvis-locks"
    folder.mkdir(parents=True)
    path = str(folder / "tiny.lock")
    hold = f"import filelock, time\nwith filelock.FileLock({path!r}):\n    print(1, flush=True), time.sleep(60)"
    holder = subprocess.Popen([sys.executable, "-c", hold], stdout=subprocess.PIPE)
    assert holder.stdout.read(1) == b"1"
    environment = {"WARP_CACHE_PATH": str(tmp_path)}
    processes = [start(**environment) for _ in range(6)]
    for process in processes:
        lines = iter(process.stderr.readline, "")
        assert WAITING in next(line for line in lines if "kernels" in line)
    assert not objects(tmp_path)
    holder.kill()
    holder.communicate()
    texts = [logged(process) for process in processes]
    assert WAITING not in "".join(texts), "it is said once"
    assert sum(COMPILED in text for text in texts) == 1, texts
    assert all("compiling kernels, once: about 10 s" in text for text in texts if COMPILED in text)
    assert len(objects(tmp_path)) == 1
    assert "kernels" not in logged(start(**environment)), "nothing is said of what is there"


@pytest.mark.slow
def test_cache_falls_back_to_temporary_directory(start, tmp_path):
    text = logged(start(WARP_CACHE_PATH="/dev/null/cache", TMPDIR=str(tmp_path)))
    assert "UserWarning: Warp's cache is not writable" in text and COMPILED in text
    assert len(objects(tmp_path)) == 1


def test_read_only_cache_is_reused(tmp_path, monkeypatch):
    old, base = tmp_path / "old", tmp_path / "temporary"
    (old / "wp_module_1234567").mkdir(parents=True)
    base.mkdir()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(old))
    monkeypatch.setattr(tempfile, "tempdir", str(base))
    assert kernel_cache._writable_cache() == old

    def refuse(**_):
        raise PermissionError("read-only")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", refuse)
    for _ in range(2):
        wp.config.kernel_cache_dir = str(old)
        with pytest.warns(UserWarning, match=r"is not writable \(read-only\)"):
            folder = kernel_cache._writable_cache()
        assert folder.parent.parent == base and str(folder) == wp.config.kernel_cache_dir
        assert (folder / "wp_module_1234567").resolve() == old / "wp_module_1234567"
    if hasattr(os, "getuid"):
        folder.parent.chmod(0o777)
        with pytest.warns(UserWarning):
            assert kernel_cache._writable_cache().parent != folder.parent, "others could have written there"


def test_file_system_without_locks_compiles(tmp_path, monkeypatch, caplog):
    def refuse(*_, **__):
        raise OSError("no locks available")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    with caplog.at_level(logging.INFO, "warpvis"), kernel_cache._one_process(poses_to_opencv.module):
        pass
    assert caplog.messages == ["kernels are compiled without a lock: no locks available"]


def test_compiler_failure_is_raised(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no compiler")

    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    monkeypatch.setattr(poses_to_opencv.module, "execs", {})
    monkeypatch.setattr(wp, "load_module", fail)
    with pytest.raises(RuntimeError, match="no compiler"):
        load_module(poses_to_opencv)
    assert not kernel_cache.is_compiling()


def test_launch_uses_loaded_block_dim():
    """Otherwise every call would access the cache, and a launch would compile the variant without a lock."""
    load_module(poses_to_opencv)
    loaded = {block_dim for context, block_dim in poses_to_opencv.module.execs if context is None}
    poses = wp.zeros(1, dtype=wp.transform, device="cpu")
    wp.launch(poses_to_opencv, dim=1, inputs=[poses, wp.quat_identity(), wp.empty_like(poses)], device="cpu")
    assert {block_dim for context, block_dim in poses_to_opencv.module.execs if context is None} == loaded == {1}


@pytest.mark.slow
def test_launches_go_through_kernel_cache():
    """Only modules that call `load_module` themselves launch without `kernel_cache.launch`."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr == "launch" and getattr(node.value, "id", "") == "wp":
                found.append(path.relative_to(PACKAGE).as_posix())
    assert found == ["core/kernel_cache.py", "core/threads.py", "core/threads.py", "scene/acceleration/bvh.py"]


ENDING = "from warpvis.cli._interrupts import exiting_on_interrupt\nwith exiting_on_interrupt():\n"
SWALLOWS = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5)
except BaseException:
    pass
"""


@pytest.mark.parametrize(
    ("work", "code"),
    [
        ("import swallows", 130),
        ("raise KeyboardInterrupt", 130),
        ("import os, signal, time; os.kill(os.getpid(), signal.SIGINT); time.sleep(60)", 130),
        ("raise SystemExit(3)", 3),
    ],
)
def test_ctrl_c_ends_the_process(work, code, tmp_path):
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    script = f"{ENDING}    {work}\n    print(1)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (code, "") and "Traceback" not in done.stderr


def test_ctrl_c_during_import_of_command_line():
    script = "import os, signal, sys\nfrom warpvis.__main__ import main\n"
    script += "class Finder:\n    def find_spec(self, name, *_):\n"
    script += "        if name == 'tyro': os.kill(os.getpid(), signal.SIGINT)\n"
    script += "sys.meta_path.insert(0, Finder())\nmain()\nprint(1)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_ctrl_c_during_compilation(start, tmp_path):
    work = "".join(f"    {line}\n" for line in COLD.strip().splitlines())
    process = start(ENDING + work, WARP_CACHE_PATH=str(tmp_path))
    lines = iter(process.stderr.readline, "")
    assert any("compiling kernels" in line for line in lines)
    process.send_signal(signal.SIGINT)
    text = process.communicate()[1]
    assert process.returncode == 130 and "Traceback" not in text, text
    assert not objects(tmp_path) or COMPILED not in text
