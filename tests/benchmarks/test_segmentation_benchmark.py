"""The benchmark of segmentation: what it prints and writes, and what it says of bad arguments."""

import json

import pytest
import segmentation

from seo_slam.config import Config
from seo_slam.evaluation.segmentation_protocols import PROTOCOLS

TINY = ["--worlds", "SM1", "--seeds", "0", "--frames", "24", "--size", "160x120", "--level", "0.5", "--jobs", "1"]
VARIANTS = ["full", "no segments"]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("segmentation")


@pytest.fixture(scope="module")
def printed(out):
    """What is printed of one room and two variants; its files lie in ``out``."""
    with pytest.MonkeyPatch.context() as patch:
        lines = []
        patch.setattr("builtins.print", lambda *words, **_: lines.append(" ".join(map(str, words))))
        words = [*TINY, "--variants", ",".join(VARIANTS), "--set", "embedder.name=hashed", "--set", "status.observations=3"]
        assert segmentation.main([*words, "--out", str(out)]) == 0
    return json.loads(lines[-1])


def test_one_json_object_with_what_the_protocols_ask_for(printed):
    assert (printed["worlds"], printed["seeds"], printed["level"], printed["odometry"]) == (["SM1"], [0], 0.5, "true")
    assert printed["image_encoder"].startswith("simulated encoder")
    assert printed["embedder"] == "hashed"
    assert list(printed["protocols"]) == list(PROTOCOLS)
    assert list(printed["variants"]) == VARIANTS
    assert printed["failures"] == []
    for variant in printed["variants"].values():
        assert variant == {**variant["per_world"]["SM1"], "per_world": variant["per_world"]}
        for row in variant["protocols"].values():
            assert all(0 <= row[key] <= 1 for key in ("miou", "fmiou", "macc"))
            assert row["counts"]["matched"] + row["counts"]["missed"] >= row["counts"]["visible"] > 0
            assert row["odr"] == pytest.approx(row["counts"]["predicted"] / row["counts"]["visible"])
    assert "numpy" in printed["versions"]


def test_the_map_finds_most_things_and_segments_add_objects(printed):
    full, bare = (printed["variants"][name]["protocols"]["segmentation/dualmap"] for name in VARIANTS)
    assert full["miou"] > 0.3
    assert full["counts"]["predicted"] >= bare["counts"]["predicted"] > 0


def test_the_files_say_the_same(printed, out):
    assert json.loads((out / "segmentation.json").read_text()) == printed
    rows = [json.loads(line) for line in (out / "runs.jsonl").read_text().splitlines()]
    assert [(row["world"], row["seed"], row["variant"]) for row in rows] == [("SM1", 0, name) for name in VARIANTS]
    for row in rows:
        assert len(row["objects"]) == row["landmarks"]
        found = {thing["id"] for thing in row["things"] if thing["objects"]}
        assert found == {item["of"] for item in row["objects"]} - {None}
        assert row["protocols"]["segmentation/dualmap"]["miou"] == pytest.approx(
            printed["variants"][row["variant"]]["protocols"]["segmentation/dualmap"]["miou"]
        )
    table = (out / "segmentation.md").read_text()
    assert table.count("\n| full |") == len(PROTOCOLS)
    assert "simulated encoder" in table


def test_every_variant_is_a_preset_with_settings_that_exist():
    given = segmentation.options().parse_args([*TINY, "--variants", "all"])
    (job,) = segmentation.jobs_from(given)
    preset = Config.preset("dualmap")
    changed = {name: config for name, (variant, config) in job.variants.items() if variant.settings}
    assert set(changed) == {name for name, variant in segmentation.VARIANTS.items() if variant.settings}
    assert not [name for name, config in changed.items() if config == preset]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--worlds", "moon"], "--worlds: got 'moon', wanted some of rooms, homes, all, SM1"),
        (["--variants", "fuller"], "--variants: got 'fuller', wanted some of all, full"),
        (["--variants", ","], "--variants: got none"),
        (["--worlds", "house"], "the house needs --meshes DIR"),
        (["--jobs", "0"], "wanted at least 1 and 2"),
        (["--set", "status.observation=3"], "did you mean 'observations'"),
    ],
)
def test_bad_arguments_end_with_usage_and_reason(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        segmentation.main([*TINY, *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err
