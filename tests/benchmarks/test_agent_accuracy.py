import json

import agent_accuracy
import pytest

TINY = [
    "--rooms",
    "SM1",
    "--seeds",
    "0",
    "--frames",
    "30",
    "--size",
    "160x120",
    "--level",
    "0.5",
    "--jobs",
    "1",
    "--set",
    "embedder.name=hashed",
]


def run(capsys, *words):
    assert agent_accuracy.main([*TINY, *words]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_sweep_compares_each_accuracy_with_the_map_without_agents(tmp_path, capsys):
    printed = run(capsys, "--accuracies", "0.5,1.0", "--out", str(tmp_path))
    assert printed["failures"] == []
    assert printed["models"]["kind"] == "simulated model"
    assert [entry["accuracy"] for entry in printed["sweep"]] == [0.5, 1.0]
    for entry in printed["sweep"]:
        assert entry["f1_difference"] == pytest.approx(entry["f1"]["mean"] - printed["base"]["f1"]["mean"], abs=1e-4)
        assert entry["runs"] == printed["base"]["runs"] == 1
    assert json.loads((tmp_path / "agent_accuracy.json").read_text()) == printed
    assert len((tmp_path / "agent_accuracy.md").read_text().splitlines()) == 5


@pytest.mark.parametrize("words", ["0.5,1.5", "much"])
def test_no_such_accuracy(words, capsys):
    with pytest.raises(SystemExit):
        agent_accuracy.main([*TINY, "--accuracies", words])
    assert words.split(",")[-1] in capsys.readouterr().err
