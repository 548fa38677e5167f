# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Server and styles of the live pages."""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from warpvis.core.checks import is_whole
from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    from viser import ViserServer

STYLE = "font-size:0.8em;line-height:1.35;padding:0 0.6em"
CELL = "padding:0.15em 0.5em 0.15em 0;vertical-align:top;border-top:1px solid rgba(128,128,128,0.3)"


def serve(host: str, port: int) -> ViserServer:
    """Start a server at the port, or the next free one."""
    if not is_whole(port) or not 0 < port < 1 << 16:
        raise WarpvisError(f"port must be a whole number from 1 to 65535, got {port!r}")
    try:
        import viser
    except ImportError:
        raise WarpvisError("the viewer needs viser, which is missing: pip install 'warpvis[view]'") from None
    _check_address(host)
    options: dict[str, Any] = {"host": host, "port": int(port), "verbose": False}
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner; the caller prints the page's address
            return viser.ViserServer(**options)
    except OSError as error:
        raise WarpvisError(f"the viewer cannot listen on {host}:{port}: {error.strerror or error}") from None


def stop(server: ViserServer) -> None:
    """Stop a server without its messages."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _check_address(host: str) -> None:
    """Check that this machine can listen on an address."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except (OSError, TypeError, ValueError) as error:
        raise WarpvisError(f"the viewer cannot listen on host {host!r}: {error}") from None


def color_dot(color: Sequence[int]) -> str:
    """Return a dot in an sRGB color."""
    red, green, blue = color
    return (
        f'<span style="display:inline-block;width:0.75em;height:0.75em;border-radius:50%;margin-right:0.4em;'
        f'background:rgb({red},{green},{blue})"></span>'
    )
