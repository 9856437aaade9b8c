"""`SceneFolder`: the scene files of one folder, and of no other place."""

import re
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

from irs_gym.radio.scene import Scene, load_scene

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_SAVING = Lock()  # between looking whether a file is there and writing it


@dataclass(frozen=True)
class SceneFolder:
    """A folder whose scene files can be opened and saved by their names alone: no path leads out
    of it, and neither does a link.

    Raises ``NotADirectoryError`` where it is no folder.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from irs_gym import load_scene
    >>> folder = SceneFolder(Path(mkdtemp()))
    >>> folder.save(load_scene("paper"), "mine").name
    'mine.json'
    >>> folder.names(), folder.open("mine").name
    (['mine'], 'mine')
    >>> folder.save(load_scene("paper"), "../elsewhere")
    Traceback (most recent call last):
    ValueError: name='../elsewhere' must be made of letters, digits, '_', '-' and '.'
    """

    path: Path

    def __post_init__(self) -> None:
        if not self.path.is_dir():
            raise NotADirectoryError(f"folder={str(self.path)!r} is no folder")
        object.__setattr__(self, "path", self.path.resolve())

    def names(self) -> list[str]:
        """Names of the files that can be opened, sorted."""
        return sorted(
            file.stem
            for file in self.path.glob("*.json")
            if _NAME.fullmatch(file.stem) and file.is_file() and not file.is_symlink()
        )

    def open(self, name: str) -> Scene:
        """The scene of that name.

        Raises
        ------
        OSError
            Where there is no such file, or it cannot be read.
        ValueError
            Where the name is none, the file is a link, or no valid scene.
        """
        return load_scene(self._file(name))

    def save(self, scene: Scene, name: str, *, is_replaced: bool = False) -> Path:
        """Write the scene under a name, which becomes its own, atomically; returns the file.

        Raises
        ------
        FileExistsError
            Where such a file is there, unless it is to be replaced.
        OSError
            Where it cannot be written.
        ValueError
            Where the name is none, or the file is a link.
        """
        file = self._file(name)
        with _SAVING:
            if file.exists() and not is_replaced:
                raise FileExistsError(f"{file.name} is there already")
            scene.model_copy(update={"name": file.stem}).save(file)

        return file

    def _file(self, name: str) -> Path:
        bare = name.removesuffix(".json")
        if not _NAME.fullmatch(bare):
            raise ValueError(f"name={name!r} must be made of letters, digits, '_', '-' and '.'")

        file = self.path / f"{bare}.json"
        if file.is_symlink():
            raise ValueError(f"{file.name} is a link, which may lead out of the folder")

        return file
