"""Facts of the folder of scenes: names lead nowhere else, and nothing is overwritten unasked."""

import pytest

from irs_gym import load_scene
from irs_gym.workbench.scene_folder import SceneFolder

PAPER = load_scene("paper")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "inside").mkdir()
    return SceneFolder(tmp_path / "inside")


@pytest.mark.parametrize(
    "name",
    [
        "../out",
        "/tmp/out",
        "..",
        ".",
        "",
        ".hidden",
        "a/b",
        "a\\b",
        "C:out",
        "a\0b",
        "a\nb",
        "ü",
        "~",
        "x" * 101,
        ".json",
    ],
)
def test_no_name_leads_out_of_the_folder(folder, name):
    with pytest.raises(ValueError, match="must be made of letters"):
        folder.save(PAPER, name)
    with pytest.raises(ValueError, match="must be made of letters"):
        folder.open(name)
    assert list(folder.path.parent.rglob("*.json")) == []


def test_what_is_saved_can_be_opened_and_has_the_name_of_its_file(folder):
    file = folder.save(PAPER, "hall.json")
    assert file == folder.path / "hall.json"
    assert folder.names() == ["hall"]
    assert folder.open("hall") == PAPER.model_copy(update={"name": "hall"})


def test_a_file_is_replaced_only_where_that_is_asked_for(folder):
    folder.save(PAPER, "hall")
    other = PAPER.model_copy(update={"target_db": -60.0})
    with pytest.raises(FileExistsError, match=r"hall\.json is there already"):
        folder.save(other, "hall")
    assert folder.open("hall").target_db == PAPER.target_db
    folder.save(other, "hall", is_replaced=True)
    assert folder.open("hall").target_db == -60.0


def test_links_are_neither_listed_nor_followed(folder):
    secret = folder.path.parent / "secret.json"
    PAPER.save(secret)
    before = secret.read_bytes()
    (folder.path / "link.json").symlink_to(secret)
    (folder.path / "dangling.json").symlink_to(folder.path.parent / "new.json")
    assert folder.names() == []
    for name in ("link", "dangling"):
        with pytest.raises(ValueError, match="is a link"):
            folder.open(name)
        with pytest.raises(ValueError, match="is a link"):
            folder.save(PAPER, name, is_replaced=True)
    assert secret.read_bytes() == before
    assert not (folder.path.parent / "new.json").exists()


def test_a_file_that_is_no_scene_is_told_by_its_field(folder):
    (folder.path / "odd.json").write_text('{"name": "odd"}')
    with pytest.raises(ValueError, match="room: Field required"):
        folder.open("odd")


def test_a_folder_that_is_none_is_told(tmp_path):
    with pytest.raises(NotADirectoryError, match="is no folder"):
        SceneFolder(tmp_path / "nowhere")
