import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from predplan import inspection
from predplan.errors import InputError, PredplanError
from predplan.inspection.markdown import escape
from predplan.labelling import AnchorTagger
from predplan.labelling.readers import RawText, read_raw
from predplan.palette import colour_of
from tests.inspection.samples import METHODS, SETS, VOCABULARY, write_empty, write_sample
from tests.labelling.generated import draw_corpus, write_raw

PICTURE, TEXT, CURVE = "EncodedImage:blob", "TextDocument:text", "Scalars:scalars"
MCAP_MAGIC = b"\x89MCAP0\r\n"

Found = dict[tuple[str, str], tuple[list[str], list[Any]]]


def read_back(path: Path) -> Found:
    """(entity, component) -> the timelines of its rows, and their values."""
    found: Found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name in (PICTURE, TEXT, CURVE):
                _, values = found.setdefault((chunk.entity_path, name), (list(chunk.timeline_names), []))
                values += [row[0] for row in batch[name].to_pylist()]
    return found


@pytest.mark.parametrize(
    ("name", "entities", "timeline", "steps"),
    [
        ("words", {"/association": PICTURE, "/counts": PICTURE, "/zipf": PICTURE, "/pairs": TEXT}, None, 1),
        ("bigrams", {"/association": PICTURE, "/counts": PICTURE, "/zipf": PICTURE, "/pairs": TEXT}, None, 1),
        ("anchors", {"/anchors": PICTURE, "/top": TEXT}, "training_set", len(SETS)),
        ("posteriors", {"/posteriors": PICTURE, "/changed": TEXT}, "training_set", len(SETS)),
        ("transitions", {"/transitions": PICTURE}, "training_set", len(SETS)),
        ("confusion", {"/confusion/anchor": PICTURE, "/mistakes/anchor": TEXT}, "training_set", 2),
        ("tagged", {"/sentences/5_0": TEXT, "/wrong/all/crf_clusters_posteriors": CURVE}, "sentence", 2),
        ("curve", {f"/curve/anchor/{of}": CURVE for of in ("mean", "least", "greatest")}, "labelled_sentences", 2),
        ("scores", {"/rows": TEXT}, None, 1),
    ],
)
def test_each_table_has_its_page(
    tmp_path: Path, name: str, entities: dict[str, str], timeline: str | None, steps: int
) -> None:
    inspection.record(write_sample(tmp_path, name), tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    for entity, component in entities.items():
        timelines, values = found[entity, component]
        assert timelines == ([timeline] if timeline else [])
        assert len(values) == steps
        if component == PICTURE:
            assert all(bytes(value).startswith(b"\x89PNG") for value in values)
    about = found["/about", TEXT][1][0]
    assert "tiny" in about
    assert "abababababab" in about
    assert [entry.application_id for entry in RrdReader(tmp_path / "out.rrd").blueprints()] == [f"predplan_{name}"]


@pytest.mark.parametrize(
    "name", ["words", "anchors", "posteriors", "transitions", "confusion", "tagged", "curve", "scores"]
)
def test_an_empty_table_says_so(tmp_path: Path, name: str) -> None:
    inspection.record(write_empty(tmp_path, name), tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    assert found["/rows", TEXT][1] == ["The table has no rows."]
    assert "tiny" in found["/about", TEXT][1][0]


def test_pairs_have_the_counts_of_the_bigrams(tmp_path: Path) -> None:
    artifact = write_sample(tmp_path, "words")
    inspection.record(artifact, tmp_path / "out.rrd")
    names = [escape(word) for word in (*VOCABULARY, "‹edge›")]
    pairs = pq.read_table(tmp_path / "bigrams.parquet").to_pylist()
    counted = {(names[row["previous"]], names[row["next"]]): row["n"] for row in pairs}
    rows = [
        line.strip("| ").split(" | ") for line in read_back(tmp_path / "out.rrd")["/pairs", TEXT][1][0].splitlines()
    ]
    shown = {(row[0], row[1]): int(row[2]) for row in rows[4:]}
    assert len(shown) == 20
    assert shown.items() <= counted.items()


def test_curves_are_the_mean_between_least_and_greatest(tmp_path: Path) -> None:
    inspection.record(write_sample(tmp_path, "curve"), tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    drawn = {of: found[f"/curve/{METHODS[0]}/{of}", CURVE][1] for of in ("least", "mean", "greatest")}
    assert drawn["least"] == pytest.approx([52.0, 55.0])
    assert drawn["mean"] == pytest.approx([52.5, 55.5])
    assert drawn["greatest"] == pytest.approx([53.0, 56.0])


def test_a_method_has_the_colour_it_has_in_the_report(tmp_path: Path) -> None:
    inspection.record(write_sample(tmp_path, "curve"), tmp_path / "out.rrd")
    for chunk in RrdReader(tmp_path / "out.rrd").stream().to_chunks():
        batch = chunk.to_record_batch()
        if "SeriesLines:colors" in batch.schema.names and chunk.entity_path.startswith("/curve/anchor"):
            assert f"{batch['SeriesLines:colors'][0].as_py()[0]:08x}" == f"{colour_of('anchor')[1:]}ff"
            break
    else:
        pytest.fail("no curve has a colour")


def test_wrong_tags_are_marked(tmp_path: Path) -> None:
    inspection.record(write_sample(tmp_path, "tagged"), tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    last = found["/sentences/5_0", TEXT][1][0].splitlines()[-1]
    assert last == "| \\$x\\$ | \\. | **✗ VERB** | \\. | **✗ VERB** |"
    assert found["/wrong/5_0/supervised", CURVE][1] == [1.0, 1.0]
    assert found["/wrong/5_0/anchor", CURVE][1] == [0.0, 0.0]


def test_relaxed_thresholds_are_marked(tmp_path: Path) -> None:
    inspection.record(write_sample(tmp_path, "anchors"), tmp_path / "out.rrd")
    rows = read_back(tmp_path / "out.rrd")["/top", TEXT][1][0].splitlines()[-3:]
    assert [row.split(" | ")[3] for row in rows] == ["4", "**3**", "**2**"]


@pytest.mark.parametrize("kind", ["hmm", "fhmm", "crf"])
def test_a_tagger_has_its_page(tmp_path: Path, kind: Any) -> None:
    raw = write_raw(tmp_path / "raw.txt", draw_corpus(200, 1))
    tagger = AnchorTagger(kind)
    tagger.fit(draw_corpus(60, 0), read_raw(raw), None, None)
    tagger.save(tmp_path / "model")
    inspection.record(tmp_path / "model", tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    assert {("/words", PICTURE), ("/transitions", PICTURE), ("/anchors", TEXT), ("/features", TEXT)} <= found.keys()
    assert "NOUN" in found["/features", TEXT][1][0]


def test_a_tagger_without_raw_text_has_its_page(tmp_path: Path) -> None:
    tagger = AnchorTagger()
    tagger.fit(draw_corpus(60, 0), RawText((), "spaces"), None, None)
    tagger.save(tmp_path / "model")
    inspection.record(tmp_path / "model", tmp_path / "out.rrd")
    assert ("/words", PICTURE) in read_back(tmp_path / "out.rrd")


def test_a_recording_is_kept_as_it_is(tmp_path: Path) -> None:
    first = inspection.show(write_sample(tmp_path, "scores"), tmp_path / "a.rrd")
    assert first == tmp_path / "a.rrd"
    assert inspection.show(first, tmp_path / "b.rrd") == tmp_path / "b.rrd"
    assert (tmp_path / "b.rrd").read_bytes() == first.read_bytes()


def test_mcap_becomes_a_recording(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(tiny_mcap(b"hello"))
    inspection.record(tmp_path / "run.mcap", tmp_path / "out.rrd")
    assert "/topic" in RrdReader(tmp_path / "out.rrd").store().schema().entity_paths()


def test_a_broken_mcap_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(tiny_mcap(b"hello")[:-20])
    with pytest.raises(InputError, match=r"run\.mcap: holds no message, or is cut short"):
        inspection.record(tmp_path / "run.mcap", tmp_path / "out.rrd")
    assert not (tmp_path / "out.rrd").exists()


def test_the_viewer_opens_a_recording_and_listens_on_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def run(command: Sequence[str], **_: Any) -> Any:
        file = Path(next(part for part in command if part.endswith(".rrd")))
        calls.append((list(command), read_back(file)))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", run)
    assert inspection.show(write_sample(tmp_path, "scores"), None) is None
    [(command, shown)] = calls
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert ("/rows", TEXT) in shown


def test_a_viewer_that_fails_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 1))
    with pytest.raises(PredplanError, match="--save"):
        inspection.show(write_sample(tmp_path, "scores"), None)


def test_what_is_no_artifact_is_named_with_what_is_known(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"a": [1], "b": [2]}), foreign)
    text = tmp_path / "notes.txt"
    text.write_text("no table")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "x.bin").touch()
    cut = tmp_path / "cut.parquet"
    cut.write_bytes(write_sample(tmp_path, "scores").read_bytes()[:-10])
    for artifact, said in (
        (foreign, "columns a, b"),
        (text, "txt file"),
        (folder, r"x\.bin and no model\.json"),
        (cut, "not whole Parquet"),
        (tmp_path / "absent", "no such file"),
    ):
        with pytest.raises(InputError, match=said) as caught:
            inspection.record(artifact, tmp_path / "out.rrd")
        assert str(artifact) in str(caught.value)
        assert "expected a table of predplan" in str(caught.value)
    assert not (tmp_path / "out.rrd").exists()


def test_a_missing_neighbour_names_the_stage(tmp_path: Path) -> None:
    artifact = write_sample(tmp_path, "posteriors")
    (tmp_path / "tags.parquet").unlink()
    with pytest.raises(InputError, match=r"tags\.parquet.*dvc repro anchors"):
        inspection.record(artifact, tmp_path / "out.rrd")
    assert not list(tmp_path.glob("*.rrd"))


def test_the_package_imports_no_viewer() -> None:
    code = "import sys, predplan.inspection, predplan.inspection.palette; sys.exit('rerun' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def tiny_mcap(message: bytes) -> bytes:
    """A file of one message on /topic, without schema, by the format's specification (https://mcap.dev/spec)."""

    def text(value: bytes) -> bytes:
        return struct.pack("<I", len(value)) + value

    def record(code: int, body: bytes) -> bytes:
        return struct.pack("<BQ", code, len(body)) + body

    channel = record(4, struct.pack("<HH", 1, 0) + text(b"/topic") + text(b"raw") + struct.pack("<I", 0))
    data = b"".join(
        (
            MCAP_MAGIC,
            record(1, text(b"") + text(b"predplan")),
            channel,
            record(5, struct.pack("<HIQQ", 1, 0, 1, 1) + message),
            record(15, struct.pack("<I", 0)),
        )
    )
    counted = struct.pack("<QHIIIIQQ", 1, 0, 1, 0, 0, 0, 1, 1) + struct.pack("<IHQ", 10, 1, 1)
    summary = channel + record(11, counted)
    return data + summary + record(2, struct.pack("<QQI", len(data), 0, 0)) + MCAP_MAGIC
