"""Descriptions of hands that differ from the shipped one."""

from pathlib import Path

from drake_pregrasp.resources import resource_folder

SHIPPED = "package://drake_pregrasp/five_finger_hand.yaml"
SHIPPED_TEXT = (resource_folder("models") / "five_finger_hand.yaml").read_text()
MODEL = (resource_folder("models") / "five_finger_hand.sdf").read_text()


def write_hand(folder: Path, old="", new="", *, count=1, model="", text=SHIPPED_TEXT) -> Path:
    """Writes a description, with a text replaced in it and with a model `own.sdf` if one is given.

    Args:
        folder: Where it goes, made if it is not there.
        old: What is replaced in the text.
        new: What replaces it.
        count: How often it is replaced, from the start.
        model: The content of `own.sdf`; without it, the description keeps its model.
        text: The description.
    """
    assert text.count(old) >= count
    folder.mkdir(parents=True, exist_ok=True)
    text = text.replace(old, new, count)
    if model:
        (folder / "own.sdf").write_text(model)
        text = text.replace("package://drake_pregrasp/five_finger_hand", "own")
    (folder / "hand.yaml").write_text(text)
    return folder / "hand.yaml"
