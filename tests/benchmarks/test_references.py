"""docs/references.md is what was recorded, and what was recorded passed."""

import json

from benchmarks import references


def test_the_page_is_the_record() -> None:
    rows, runs = (json.loads(path.read_text()) for path in (references.RECORD, references.MRCLAM))
    assert references.DOCS.read_text() == references.markdown(rows, runs)


def test_every_reference_was_met_by_a_test_that_is_still_there() -> None:
    rows = json.loads(references.RECORD.read_text())
    assert [(row["file"], row["test"]) for row in rows] == [(r["file"], r["test"]) for r in references.ROWS]
    for row in rows:
        assert row["outcome"] == "passed", row
        file = references.HERE.parent / references.T / row["file"]
        assert f"def {row['test']}(" in file.read_text()
