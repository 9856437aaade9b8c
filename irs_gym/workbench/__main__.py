"""`python -m irs_gym.workbench`: a scene in the browser, where its parts are moved by hand."""

import argparse
import socket
import sys
from pathlib import Path

from irs_gym.radio.scene import Scene, load_scene
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.scene_folder import SceneFolder

_LOOPBACK = "127.0.0.1"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        prog="python -m irs_gym.workbench",
        description="Open a page in the browser where the parts of a scene are moved by hand.",
    )
    made.add_argument(
        "--scene", default="paper", help="a scene of the package, or a scene file (default: paper)"
    )
    made.add_argument(
        "--folder",
        type=Path,
        default=Path(),
        help="where scene files are opened and saved, and nowhere else (default: this one)",
    )
    made.add_argument("--port", type=int, default=0, help="0 for one that is free (default)")
    made.add_argument(
        "--address",
        default=_LOOPBACK,
        help=f"where the page is served; this machine alone by default ({_LOOPBACK})",
    )
    made.add_argument(
        "--origin",
        action="append",
        default=[],
        metavar="HOST:PORT",
        help="another name in the browser's address bar that may use the page, behind a proxy, say",
    )
    made.add_argument(
        "--no-browser", action="store_true", help="serve the page without opening a browser"
    )

    return made


def main() -> int:
    """Serve the page until Ctrl-C; returns the exit status."""
    given = parser().parse_args()
    try:
        scene = load_scene(given.scene)
        Bench.of(scene)  # can be drawn
        folder = SceneFolder(given.folder)
        port = given.port or free_port(given.address)
    except (OSError, ValueError) as error:
        print(f"python -m irs_gym.workbench: {error}", file=sys.stderr)
        return 2

    origins = [f"{host}:{port}" for host in _hosts(given.address)] + given.origin
    return _serve(scene, folder, given.address, port, origins, opens=not given.no_browser)


def _serve(
    scene: Scene, folder: SceneFolder, address: str, port: int, origins: list[str], *, opens: bool
) -> int:
    try:
        import panel

        from irs_gym.workbench.page import Page
    except ModuleNotFoundError as error:
        print(
            f"python -m irs_gym.workbench: {error.name} is missing: "
            "pip install 'irs_gym[workbench]'",
            file=sys.stderr,
        )
        return 2

    print(f"the workbench is at http://{origins[0]} (Ctrl-C ends it)", flush=True)
    try:
        # each visit has a page of its own
        panel.serve(
            lambda: Page(scene, folder).layout,
            address=address,
            port=port,
            websocket_origin=origins,
            show=opens,
            verbose=False,
            title="irs_gym workbench",
        )
    except OSError as error:
        print(f"python -m irs_gym.workbench: port {port}: {error.strerror}", file=sys.stderr)
        return 2

    return 0


def free_port(address: str) -> int:
    """A port of the address that nothing listens on."""
    with socket.create_server((address, 0)) as found:
        port: int = found.getsockname()[1]

    return port


def _hosts(address: str) -> list[str]:
    """Names in the address bar that lead to the page: no page of another site may talk to it."""
    if address in (_LOOPBACK, "localhost"):
        return [_LOOPBACK, "localhost"]
    if address in ("0.0.0.0", "::", ""):
        return [_LOOPBACK, "localhost", socket.gethostname(), socket.getfqdn()]

    return [address]


if __name__ == "__main__":
    sys.exit(main())
