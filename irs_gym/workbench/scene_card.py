"""`SceneCard`: where scenes are opened and saved."""

from collections.abc import Callable

import panel as pn

from irs_gym.radio.scene import load_scene, scene_names
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.scene_folder import SceneFolder
from irs_gym.workbench.texts import reason_of
from irs_gym.workbench.widgets import note, refusal, say, title


class SceneCard:
    """Opens scenes of the package and of a folder, and saves the one on the bench.

    Parameters
    ----------
    folder
        Where files are.
    bench
        Gives the bench as it is.
    put
        Takes a bench with another scene.
    saved
        Is called once a file is written.
    """

    def __init__(
        self,
        folder: SceneFolder,
        bench: Callable[[], Bench],
        put: Callable[[Bench], None],
        saved: Callable[[], None],
    ) -> None:
        self._folder = folder
        self._bench = bench
        self._put = put
        self._has_saved = saved

        self._list = pn.widgets.Select(label="Open", width=200, groups=self._choices())
        opens = pn.widgets.Button(label="Open", width=80, align="end")
        opens.on_click(lambda _: self._open())
        self._name = pn.widgets.TextInput(label="Save as", width=200)
        saves = pn.widgets.Button(label="Save", width=80, align="end", color="primary")
        saves.on_click(lambda _: self._save())
        self._replace = pn.widgets.Checkbox(label="replace the file that is there")
        self._refusal = refusal()
        self._note = note()

        self.layout = pn.Column(
            title("Scene"),
            pn.Row(self._list, opens),
            pn.Row(self._name, saves),
            self._replace,
            self._refusal,
            self._note,
        )

    def fit(self, bench: Bench) -> None:
        """Take the name of another scene."""
        self._name.value = bench.scene.name
        say(self._refusal, "")

    def _choices(self) -> dict[str, dict[str, tuple[str, str]]]:
        """Scenes that can be opened, by where they are from; the package's "paper" is not the
        folder's.
        """
        of_package = {name: ("package", name) for name in scene_names()}
        of_folder = {name: ("folder", name) for name in self._folder.names()}
        folder = {"in the folder": of_folder} if of_folder else {}

        return {"of the package": of_package, **folder}

    def _open(self) -> None:
        home, name = self._list.value
        try:
            scene = load_scene(name) if home == "package" else self._folder.open(name)
            bench = Bench.of(scene)
        except (OSError, ValueError) as error:
            say(self._refusal, reason_of(error))
            return

        say(self._note, "")
        self._put(bench)

    def _save(self) -> None:
        bench = self._bench()
        try:
            file = self._folder.save(
                bench.shown_scene, self._name.value, is_replaced=self._replace.value
            )
        except FileExistsError as error:
            say(self._refusal, f"{error}: tick the box to replace it")
            return
        except (OSError, ValueError) as error:
            say(self._refusal, reason_of(error))
            return

        say(self._refusal, "")
        how = "" if bench.is_irs_on else ", without panels: they have 0 elements"
        say(self._note, f"Saved as {file.name}{how}.")
        self._name.value = file.stem
        self._replace.value = False
        self._list.groups = self._choices()
        self._list.value = ("folder", file.stem)
        self._has_saved()

    @property
    def name(self) -> str:
        """The name under which the scene is saved."""
        return str(self._name.value)
