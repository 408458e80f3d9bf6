from pathlib import Path

import pytest
from pydantic import ValidationError

from predplan.errors import InputError
from stages.settings import Settings, load_settings

GOOD = """\
root: .
params: params.yaml
out: data
reports: data/reports
workers: 2
scheduler: null
labelling:
  corpora:
    brown:
      source: brown
      sizes: [10]
      curve: [10, 20]
      draws: 1
"""
KEYS = ", ".join(Settings.model_fields)


@pytest.fixture
def params(tmp_path: Path) -> Path:
    return tmp_path / "params.yaml"


def load(params: Path, text: str) -> Settings:
    params.write_text(text, encoding="utf-8")
    return load_settings(params)


def fault(params: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        load(params, text)
    message = str(caught.value)
    assert message.startswith(str(params))
    return message.removeprefix(str(params))


def test_settings_are_read_and_frozen(params: Path) -> None:
    settings = load(params, GOOD)
    assert (settings.root, settings.out, settings.workers, settings.scheduler) == (".", "data", 2, None)
    assert settings.labelling.corpora["brown"].source == "brown"
    with pytest.raises(ValidationError, match="frozen"):
        settings.workers = 3


def test_a_scheduler_may_be_named(params: Path) -> None:
    assert load(params, GOOD.replace("null", "tcp://127.0.0.1:8786")).scheduler == "tcp://127.0.0.1:8786"


@pytest.mark.parametrize(
    ("good", "bad", "message"),
    [
        (
            "workers:",
            "worker: 2\nworkers:",
            f": worker: unknown key; did you mean 'workers'? allowed: {KEYS}",
        ),
        ("source:", "zzz: 1\n      source:", ": labelling.corpora.brown.zzz: unknown key; allowed: "),
        ("labelling:", "labelling:\n  training: {modl: hmm}", ": labelling.training.modl: unknown key; "),
        ("workers: 2", "workers: two", ': workers: found "two", must be a valid integer'),
        ("workers: 2", "workers: 2.5", ": workers: found 2.5, must be a valid integer"),
        ("workers: 2", "workers: '2'", ': workers: found "2", must be a valid integer'),
        ("workers: 2", "workers: 0", ": workers: found 0, must be greater than or equal to 1"),
        ("out: data", "out: 3", ": out: found 3, must be a valid string"),
        ("out: data", "out: {a: 1}", ": out: found a mapping, must be a valid string"),
        ("out: data\n", "", ": out: missing"),
        ("null", "here", ': scheduler: found "here", must match pattern'),
        ("brown:", "Brown Corpus:", ': labelling.corpora.Brown Corpus: found "Brown Corpus", must match pattern'),
        ("out: data", "out: data\nout: more", ', line 4: found duplicate key "out"'),
        ("out: data", "out: [data", ", line 4: "),
    ],
)
def test_a_fault_names_the_key_what_was_found_and_what_is_allowed(
    params: Path, good: str, bad: str, message: str
) -> None:
    assert fault(params, GOOD.replace(good, bad, 1)).startswith(message)


def test_all_faults_are_listed_at_once(params: Path) -> None:
    text = GOOD.replace("workers: 2", "workers: 0").replace("null", "here").replace("source", "sorce")
    lines = fault(params, text).splitlines()
    assert [line.split(":")[0] for line in lines[1:]] == [
        "  workers",
        "  scheduler",
        "  labelling.corpora.brown.source",
        "  labelling.corpora.brown.sorce",
    ]


@pytest.mark.parametrize(("text", "found"), [("", "null"), ("- 1\n", "a list"), ("hello\n", '"hello"')])
def test_a_file_that_is_no_mapping_is_said(params: Path, text: str, found: str) -> None:
    assert fault(params, text) == f": the whole file: found {found}, must be a mapping"


def test_a_missing_or_binary_file_is_said(params: Path) -> None:
    with pytest.raises(InputError, match=r"params\.yaml: cannot be read: No such file"):
        load_settings(params)
    params.write_bytes(b"root: \xff")
    with pytest.raises(InputError, match="not UTF-8 at byte 6"):
        load_settings(params)
