"""The commands, from files to exit codes; bad input is one line and exit code 2."""

import gzip
import json
import resource
import subprocess
import sys
from contextlib import suppress
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from predplan.cli import run
from tests.labelling.generated import TAGS, draw_corpus, write_labelled, write_raw

CONLLU = """# a comment
1-2	lightrun	_	_	_	_	_	_	_	_
1	the	l	X	p	f	2	det	_	m
2	cat	_	_	_	_	_	_	_	_

"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_labelled(folder / "train.tsv", draw_corpus(60, seed=1))
    write_labelled(folder / "gold.tsv", draw_corpus(60, seed=2))
    write_raw(folder / "raw.txt", draw_corpus(500, seed=3))
    (folder / "more.txt.gz").write_bytes(
        gzip.compress(write_raw(folder / "more.txt", draw_corpus(500, 4)).read_bytes())
    )
    (folder / "dictionary.tsv").write_text("cat\tNOUN\nis\tVERB\n")
    assert fit(folder, "--raw", folder / "raw.txt", folder / "more.txt.gz", out="model") == 0
    return folder


def fit(folder: Path, *options: object, out: str) -> int:
    labelled = ["--labelled", folder / "train.tsv"] if "--labelled" not in options else []
    return run([str(part) for part in ("label", "fit", *labelled, *options, "--out", folder / out)])


def fails(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line that a command with bad input leaves on stderr."""
    assert run([str(argument) for argument in arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("predplan: ")
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize("model", ["hmm", "fhmm", "crf"])
def test_fit_tag_and_score(files: Path, model: str, capsysbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    options = ("--model", model, "--dictionary", files / "dictionary.tsv", "--dev", files / "train.tsv")
    raw = ("--raw", files / "raw.txt", "--raw", files / "more.txt")
    assert fit(files, *options, *raw, "--loss", "ls", "--lambda", 0.9, "--seed", 3, out=model) == 0
    capsysbinary.readouterr()
    assert run(["label", "tag", str(files / model), str(files / "raw.txt")]) == 0
    tagged = capsysbinary.readouterr().out.decode()
    sentences = tagged.strip().split("\n\n")
    assert len(sentences) == 500
    assert all(len(line.split("\t")) == 10 for sentence in sentences for line in sentence.split("\n"))
    assert run(["label", "score", str(files / model), str(files / "gold.tsv"), "--json"]) == 0
    report = json.loads(capsysbinary.readouterr().out)
    assert report["accuracy"] > 0.85
    assert set(report["per_tag"]) == set(TAGS)
    assert report["per_tag"]["DET"].keys() == {"precision", "recall", "f1", "support"}
    assert run(["label", "tag", str(files / model), str(files / "raw.txt")]) == 0
    (tmp_path / "tagged.conllu").write_bytes(capsysbinary.readouterr().out)
    write_labelled(tmp_path / "gold.tsv", draw_corpus(500, seed=3))
    assert run(["label", "score", str(tmp_path / "tagged.conllu"), str(tmp_path / "gold.tsv"), "--json"]) == 0
    of_file = json.loads(capsysbinary.readouterr().out)
    assert run(["label", "score", str(files / model), str(tmp_path / "gold.tsv"), "--json"]) == 0
    assert json.loads(capsysbinary.readouterr().out)["accuracy"] == of_file["accuracy"]
    assert of_file["unknown_accuracy"] is None


def test_score_prints_a_table(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["label", "score", str(files / "model"), str(files / "gold.tsv")]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in ("accuracy", "precision", "recall", "F1", *TAGS))


def test_tags_standard_input(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    for arguments in ([], ["-"]):
        monkeypatch.setattr("sys.stdin", TextIOWrapper(BytesIO(b"the cat is !\n\n# !\n")))
        assert run(["label", "tag", str(files / "model"), *arguments]) == 0
        said = capsysbinary.readouterr().out.decode()
        assert said.startswith("1\tthe\t_\tDET\t_\t_\t_\t_\t_\t_\n2\tcat\t_\tNOUN\t")
        assert said.count("\n\n") == 2


def test_conllu_keeps_its_comments_and_columns(
    files: Path, tmp_path: Path, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    (tmp_path / "in.conllu").write_text(CONLLU)
    assert run(["label", "tag", str(files / "model"), str(tmp_path / "in.conllu")]) == 0
    expected = CONLLU.replace("1\tthe\tl\tX", "1\tthe\tl\tDET").replace("2\tcat\t_\t_", "2\tcat\t_\tNOUN")
    assert capsysbinary.readouterr().out.decode() == expected


BAD_LABELLED = {
    "empty": (b"", "the file is empty"),
    "one column": (b"the\ncat\n", "found one column"),
    "label without word": (b"the\tDET\n\tNOUN\n", "the label 'NOUN' has no word"),
    "word without label": (b"the\tDET\ncat\t\n", "the word 'cat' has no label"),
    "mixed encodings": ("the\tDET\ncafé\tNOUN\n".encode() + "thé\tNOUN\n".encode("latin-1"), "is not UTF-8"),
    "nul": (b"the\tDET\nc\0t\tNOUN\n", "NUL"),
    "cut short": (gzip.compress(b"the\tDET\ncat\tNOUN\n" * 999)[:60], "cut short"),
    "one tag": (b"the\tDET\n", "at least two"),
}


@pytest.mark.parametrize("fault", BAD_LABELLED)
def test_bad_labelled_files(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: str) -> None:
    content, message = BAD_LABELLED[fault]
    path = tmp_path / "bad.tsv"
    path.write_bytes(content)
    line = fails(capsys, "label", "fit", "--labelled", path, "--out", tmp_path / "model")
    assert message in line
    assert not (tmp_path / "model").exists()
    if fault != "one tag":
        assert str(path) in line
        assert message in fails(capsys, "label", "score", files / "model", path)
        options = ("--labelled", files / "train.tsv", "--dev", path)
        assert message in fails(capsys, "label", "fit", *options, "--out", tmp_path / "model")


def test_bad_gold(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gold, predicted = tmp_path / "gold.tsv", tmp_path / "predicted.tsv"
    gold.write_text("the\tDET\ncat\tSTRANGE\n")
    line = fails(capsys, "label", "score", files / "model", gold)
    assert str(gold) in line
    assert "'STRANGE'" in line
    predicted.write_text("the\tDET\n")
    assert "found 1 predicted tags, expected 2" in fails(capsys, "label", "score", predicted, gold)
    predicted.write_text("the\tDET\ncat\tNOUN\n\nthe\tDET\n")
    assert "found 2 sentences, expected 1" in fails(capsys, "label", "score", predicted, gold)
    predicted.write_text("the\tDET\ndog\tNOUN\n")
    assert "'dog'" in fails(capsys, "label", "score", predicted, gold)
    predicted.write_text("the\tDET\ncat\t_\n")
    assert "without a tag" in fails(capsys, "label", "score", predicted, gold)


def test_bad_text_to_tag(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "text"
    for content, message in (
        (b"", "found no sentence"),
        (b"fine\ncaf\xe9\n", "text:2: byte 0xe9 is not UTF-8"),
        (b"fine\0\n", "text:1: found a NUL"),
        (b"the\tDET\n", "text:1: found a tab"),
        (CONLLU.encode() + b"1\tthe\n", "text:6: found 2 columns"),
    ):
        path.write_bytes(content)
        assert message in fails(capsys, "label", "tag", files / "model", path)
    path.write_bytes(gzip.compress(b"the cat\n" * 99999)[:90])
    assert run(["label", "tag", str(files / "model"), str(path)]) == 2
    assert "cut short" in capsys.readouterr().err


def test_models_of_other_versions_and_no_models(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(tmp_path, "--labelled", files / "train.tsv", out="model") == 0
    header = tmp_path / "model" / "model.json"
    header.write_text(header.read_text().replace('"version": 1', '"version": 2'))
    for command, rest in (("tag", []), ("score", [files / "gold.tsv"])):
        line = fails(capsys, "label", command, tmp_path / "model", *rest)
        assert "version 2" in line
        assert "predplan label fit" in line
    header.unlink()
    assert "has no model.json" in fails(capsys, "label", "tag", tmp_path / "model")
    assert "no such folder" in fails(capsys, "label", "tag", tmp_path / "nowhere")
    options = ("--labelled", files / "train.tsv", "--out", files)
    assert "no predplan model" in fails(capsys, "label", "fit", *options)


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["label", "nonsense"],
        ["label", "fit"],
        ["label", "fit", "--labelled", "a", "--out", "b", "--model", "tree"],
        ["label", "fit", "--labelled", "a", "--out", "b", "--lambda", "2"],
        ["label", "fit", "--labelled", "nowhere", "--out", "b"],
        ["label", "fit", "--labelled", "a", "--out", "b", "--workers", "x"],
        ["label", "score", "nowhere", "nowhere"],
        ["show", "nowhere"],
    ],
)
def test_bad_usage(arguments: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    fails(capsys, *arguments)


@pytest.mark.parametrize("command", [["label", "fit"], ["label", "tag"], ["label", "score"], ["plan"]])
def test_help_shows_examples(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*command, "--help"]) == 0
    assert f"predplan {' '.join(command)} " in capsys.readouterr().out.split("Usage:")[1].split("\n", 1)[1]


def predplan(*arguments: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-c", "from predplan.cli import main; main()", *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def test_a_closed_pipe_is_quiet(files: Path) -> None:
    process = predplan("label", "tag", str(files / "model"), "-")
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with suppress(BrokenPipeError):
        process.stdin.write(b"the cat\n" * 100_000)
        process.stdin.close()
    assert process.stderr.read() == b""
    assert process.wait(60) == 141


def test_help_is_quick() -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = predplan("--help")
    said, _ = process.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert b"label" in said
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.6
