# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The live page of a scene."""

from __future__ import annotations

import contextlib
import io
import math
import os
import socket
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from warpvis.cameras.frames import Frames
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_flag, is_whole
from warpvis.errors import WarpvisError
from warpvis.scene import Scene, require_scene
from warpvis.viewer._mujoco import as_mujoco_stage
from warpvis.viewer._page import Page, write_page
from warpvis.viewer._state import ViewerState
from warpvis.visibility import Agent

if TYPE_CHECKING:
    import mujoco
    from viser import ViserServer

_PORT = 8080


class Viewer:
    """A live page, served until `close`; `wait` blocks to keep the program running.

    Example:
        >>> viewer = wv.view(scene, agents=[robot, human])
        >>> print(viewer.url)
        >>> viewer.wait()
    """

    def __init__(self, state: ViewerState, *, host: str = "localhost", port: int = _PORT, dark: bool = False) -> None:
        """Serve the page of a state.

        Args:
            state: The state to show.
            host: Address to listen on. By default, only this machine can open the page; ``"0.0.0.0"`` allows all
                machines that can reach this one.
            port: Port to listen on; if it is in use, the next free one.
            dark: Whether the page is dark.

        Raises:
            WarpvisError: If viser is missing, or an argument is invalid.
        """
        if not isinstance(state, ViewerState):
            raise WarpvisError(f"state must be a warpvis.viewer.ViewerState, got {type(state).__name__}")
        dark = check_flag(dark, "dark")
        if not is_whole(port) or not 0 < port < 1 << 16:
            raise WarpvisError(f"port must be a whole number from 1 to 65535, got {port!r}")
        self.state = state
        self.server = _serve(host, int(port))
        self.page = Page(self.server, state, dark=dark)
        self._closed = threading.Event()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def update(self) -> None:
        """Show changes that the program made to the state, and wait until they are shown."""
        self.page.gizmos.follow()
        self.page.update(wait=True)

    def save_html(self, path: str | os.PathLike[str], *, title: str = "warpvis") -> None:
        """Write the page and its table to one ``.html`` file that a browser opens without a server or a network.

        Raises:
            FileFormatError: If the file cannot be written.
        """
        write_page(self.page, path, title)

    def wait(self) -> None:
        """Wait until the page is closed or Ctrl-C is pressed."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Stop serving the page."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def view(
    scene: Scene | mujoco.MjModel,
    agents: Sequence[Agent] | None = None,
    camera: Camera | None = None,
    *,
    movable: Sequence[str] | None = None,
    objects: Sequence[str] | None = None,
    frames: Frames | None = None,
    host: str = "localhost",
    port: int = _PORT,
    dark: bool = False,
) -> Viewer:
    """Serve a live page of a scene for a browser, where users move agents and objects and see what each agent sees.

    Args:
        scene: The scene; objects move in a copy. For a MuJoCo model, which starts at its first keyframe, the geoms of
            each body form one object, and joints have sliders.
        agents: One or two agents: a robot and a person. By default, a robot with `camera` that sees the whole scene.
        camera: Camera of the default robot; by default `Camera.kinect` with unlimited range.
        movable: As for `ViewerState`, like `objects` and `frames`, which are played with a slider.
        objects: Names of the objects in the table.
        frames: Frames to play.
        host: As for `Viewer`, like `port` and `dark`.
        port: Port to listen on.
        dark: Whether the page is dark.

    Returns:
        The page, which is served until `Viewer.close` or the end of the program.

    Raises:
        WarpvisError: If viser is missing, or an argument is invalid.
    """
    if agents is not None and camera is not None:
        raise WarpvisError("camera must be None if agents are given, since agents have cameras")
    model = as_mujoco_stage(scene)
    if agents is None:
        agents = [framing_agent(scene if model is None else model.stage.scene, camera)]
    state = ViewerState(scene if model is None else model, agents, movable=movable, objects=objects, frames=frames)
    return Viewer(state, host=host, port=port, dark=dark)


def framing_agent(scene: Scene, camera: Camera | None = None) -> Agent:
    """Create a robot that sees the whole scene, with a camera, by default `Camera.kinect` with unlimited range."""
    from warpvis.pose_generators import framing

    require_scene(scene).require_objects()
    if camera is None:
        camera = replace(Camera.kinect(), near=0.0, far=math.inf)
    return Agent("robot", camera, framing(scene, camera))


def _serve(host: str, port: int) -> ViserServer:
    """Start the server."""
    try:
        import viser
    except ImportError:
        raise WarpvisError("the viewer needs viser, which is missing: pip install 'warpvis[view]'") from None
    _check_address(host)
    options: dict[str, Any] = {"host": host, "port": port, "verbose": False}
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner; the caller prints the page's address
            return viser.ViserServer(**options)
    except OSError as error:
        raise WarpvisError(f"the viewer cannot listen on {host}:{port}: {error.strerror or error}") from None


def _check_address(host: str) -> None:
    """Check that this machine can listen on an address."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except (OSError, TypeError, ValueError) as error:
        raise WarpvisError(f"the viewer cannot listen on host {host!r}: {error}") from None
