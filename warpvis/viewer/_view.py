# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Open the live page of a scene."""

from __future__ import annotations

import contextlib
import io
import math
import os
import socket
import threading
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Any

from warpvis.core.camera import Camera
from warpvis.core.checks import check_flag, is_whole
from warpvis.core.frames import Frames
from warpvis.errors import WarpvisError
from warpvis.scene import Scene, require_scene
from warpvis.viewer._mujoco import as_mujoco_stage
from warpvis.viewer._state import ViewerState
from warpvis.visibility import Agent

if TYPE_CHECKING:
    import mujoco
    from viser import ViserServer

_PORT = 8080


class Viewer:
    """A live page. It is there until `close`; `wait` keeps a program running for it.

    Example:
        >>> viewer = wv.view(scene, agents=[robot, human])
        >>> print(viewer.url)
        >>> viewer.wait()
    """

    def __init__(self, state: ViewerState, *, host: str = "localhost", port: int = _PORT, dark: bool = False) -> None:
        """Serve the page of a state.

        Args:
            state: What is shown.
            host: Address to listen on. By default only this machine can open the page; ``"0.0.0.0"`` lets all that can
                reach it.
            port: Port to listen on, or the next one that is free.
            dark: Whether the page is dark.

        Raises:
            WarpvisError: viser is missing, or the address is none.
        """
        from warpvis.viewer._page import Page

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
        """Where a browser finds the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def update(self) -> None:
        """Show the state as it is now, after it was changed by a program, and wait until it is shown."""
        self.page.gizmos.follow()
        self.page.update(wait=True)

    def save_html(self, path: str | os.PathLike[str], *, title: str = "warpvis") -> None:
        """Write what the page shows now as one file that a browser opens without a server or a network.

        Args:
            path: File to write, ``.html``.
            title: What stands above the table.

        Raises:
            WarpvisError: The file cannot be written.
        """
        from warpvis.viewer._html import write_page

        write_page(self.page, path, title)

    def wait(self) -> None:
        """Wait until the page is closed, or Ctrl-C is pressed."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Take the page down."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
    """Open a live page of a scene in the browser, in which agents and objects are moved and what is seen changes.

    Args:
        scene: The world; the viewer moves things in a copy. Of a MuJoCo model, which begins at its first keyframe, the
            geoms of each body are one object, and joints have sliders.
        agents: One or two: a robot and a person. By default a robot with `camera` from where all of the scene is seen.
        camera: The camera of a robot that was not given; `Camera.kinect` of any range by default.
        movable: Names or patterns of the objects that may be dragged; by default those labelled as an object, a person
            or a robot, and what is movable already.
        objects: Names of the objects in the table; by default all but the ground, or if they are many those labelled
            as an object, a person or a robot.
        frames: Frames to play: where the first agent is in each, and the scene's movable objects; a slider shows them.
        host: Address to listen on. By default only this machine can open the page.
        port: Port to listen on, or the next one that is free.
        dark: Whether the page is dark.

    Returns:
        The page, which stays until its `Viewer.close`, or until the program ends.

    Raises:
        WarpvisError: viser is missing, or an argument is not what it has to be.
    """
    if agents is not None and camera is not None:
        raise WarpvisError("camera is that of a robot that is not given; agents have cameras of their own")
    model = as_mujoco_stage(scene)
    if agents is None:
        agents = [framing_agent(scene if model is None else model.stage.scene, camera)]
    state = ViewerState(scene if model is None else model, agents, movable=movable, objects=objects, frames=frames)
    return Viewer(state, host=host, port=port, dark=dark)


def framing_agent(scene: Scene, camera: Camera | None = None) -> Agent:
    """Make a robot from whose eyes all of a scene is seen.

    Args:
        scene: The scene.
        camera: Its camera; `Camera.kinect` of any range by default.

    Raises:
        WarpvisError: The scene is empty, or the camera is none.
    """
    from warpvis.pose_generators import framing

    require_scene(scene).require_objects()
    if camera is None:
        camera = replace(Camera.kinect(), near=0.0, far=math.inf)
    return Agent("robot", camera, framing(scene, camera))


def _serve(host: str, port: int) -> ViserServer:
    """Start the server.

    Raises:
        WarpvisError: viser is missing, or the address is none.
    """
    try:
        import viser
    except ImportError:
        raise WarpvisError("the viewer needs viser, which is missing: pip install 'warpvis[view]'") from None
    _check_address(host)
    options: dict[str, Any] = {"host": host, "port": port, "verbose": False}
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it draws a box; who calls says where the page is
            return viser.ViserServer(**options)
    except OSError as error:
        raise WarpvisError(f"the viewer cannot listen on {host}:{port}: {error.strerror or error}") from None


def _check_address(host: str) -> None:
    """Check that this machine can listen on an address.

    Raises:
        WarpvisError: It cannot.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except (OSError, TypeError, ValueError) as error:
        raise WarpvisError(f"the viewer cannot listen on host {host!r}: {error}") from None
