"""The notebooks run from the first cell to the last."""

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
REAL = "5_real_speech"


def execute(path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    folder = {"metadata": {"path": str(path.parent)}}
    nbclient.NotebookClient(
        notebook, timeout=900, kernel_name="python3", resources=folder
    ).execute()
    errors = [
        output.text
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if output.output_type == "stream" and output.name == "stderr"
    ]
    assert not errors
    return notebook


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in NOTEBOOKS if path.stem != REAL], ids=lambda path: path.stem
)
def test_a_notebook_runs_without_an_error_or_a_warning(path):
    execute(path)


@pytest.mark.real_data
def test_the_notebook_of_real_speech_runs(data_folder, monkeypatch):
    monkeypatch.setenv("MOCAP_FIT_DATA", str(data_folder))
    (path,) = (path for path in NOTEBOOKS if path.stem == REAL)
    execute(path)


def test_notebooks_are_small_and_hold_no_path_of_a_machine():
    assert [path.stem[:1] for path in NOTEBOOKS] == ["1", "2", "3", "4", "5"]
    for path in NOTEBOOKS:
        text = path.read_text("utf-8")
        assert len(text) < 600_000
        assert "/home/" not in text
        assert "/root/" not in text
