"""`trace`: the radio map of a scene's room by Sionna RT, with walls and boxes as our own meshes."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from irs_gym import RadioMap, Scene, from_sionna
from irs_gym.radio.geometry import is_in_footprint

# The faces of a box as triangles whose normals point outwards; the bits of a corner's number are
# its x, y and z.
TRIANGLES = np.array(
    [
        *((0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6)),  # below, above
        *((0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3)),  # y low, y high
        *((0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)),  # x low, x high
    ]
)
# An antenna on a wall is moved into the room by this much: rays cannot start within a surface.
INSET_M = 0.05
MATERIALS = {"room": ("concrete", 0.2), "obstacle": ("metal", 0.01)}  # of ITU-R P.2040; metres


def write_box(path: Path, lower: Any, upper: Any, is_room: bool = False) -> None:
    """Write a box as a PLY mesh. Normals point out of the material: outwards, but into a room.

    Sionna turns the normals of a file around, which leaves them as in the scenes that it brings
    along.
    """
    z, y, x = np.meshgrid(*zip(lower[::-1], upper[::-1], strict=True), indexing="ij")
    corners = np.stack([x, y, z], axis=-1).reshape(8, 3)
    triangles = TRIANGLES[:, ::-1] if is_room else TRIANGLES

    header = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    body = [" ".join(f"{value:.9g}" for value in corner) for corner in corners]
    body += [" ".join(map(str, (3, *triangle))) for triangle in triangles.tolist()]
    path.write_text("\n".join([*header, *body]) + "\n", encoding="ascii")


def write_meshes(scene: Scene, folder: Path) -> dict[str, list[Path]]:
    """Write the meshes of a scene's room and obstacles; their paths by material."""
    room = scene.room
    meshes = {"room": [folder / "room.ply"], "obstacle": []}
    write_box(meshes["room"][0], (*room.lower, 0.0), (*room.upper, room.height), is_room=True)

    for n, box in enumerate(scene.obstacles):
        meshes["obstacle"].append(folder / f"obstacle_{n}.ply")
        write_box(meshes["obstacle"][-1], box.lower, box.upper)

    return meshes


def inside(scene: Scene, position: tuple[float, float, float]) -> list[float]:
    """A position, moved off the walls."""
    low = np.array([*scene.room.lower, 0.0])
    high = np.array([*scene.room.upper, scene.room.height])
    moved: list[float] = np.clip(position, low + INSET_M, high - INSET_M).tolist()
    return moved


def trace(scene: Scene, cell_size: float, samples: int, max_depth: int, seed: int) -> RadioMap:
    """Radio map at the robot's antenna height, without IRS, from isotropic antennas.

    Needs sionna-rt (``pip install "irs_gym[sionna]"``). Paths are direct, reflected up to
    ``max_depth`` times, or diffracted once; nothing passes through walls or boxes.
    """
    from sionna import rt

    grid = scene.grid(cell_size)
    world = _world_of(scene, rt)
    middle = [
        (low + high) / 2 for low, high in zip(scene.room.lower, scene.room.upper, strict=True)
    ]
    result = rt.RadioMapSolver()(
        world,
        center=[*middle, scene.antenna_height],
        orientation=[0.0, 0.0, 0.0],
        size=[columns * cell_size for columns in grid.shape],
        cell_size=[cell_size, cell_size],
        samples_per_tx=samples,
        max_depth=max_depth,
        refraction=False,
        diffraction=True,
        seed=seed,
    )

    return from_sionna(result, ~is_in_footprint(grid.centres(), scene.boxes))


def _world_of(scene: Scene, rt: Any) -> Any:
    """Sionna's scene of ours: room and boxes, and a transmitter at each access point."""
    world = rt.load_scene()
    world.frequency = scene.carrier_ghz * 1e9

    with TemporaryDirectory() as folder:
        for part, paths in write_meshes(scene, Path(folder)).items():
            material, thickness = MATERIALS[part]
            surface = rt.ITURadioMaterial(f"{part}-{material}", material, thickness=thickness)
            objects = [
                rt.SceneObject(fname=str(path), name=path.stem, radio_material=surface)
                for path in paths
            ]
            world.edit(add=objects)

    isotropic = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    world.tx_array = world.rx_array = isotropic
    for n, point in enumerate(scene.access_points):
        world.add(rt.Transmitter(f"access-point-{n}", position=inside(scene, point.position)))

    return world
