"""What docs/ say of messages, missions and dependencies is what the code does."""

import pytest

from agents.wire import messages as m
from agents.wire.topics import TOPICS
from tests.packaging import docs_tables as tables


def test_every_topic_stands_in_the_docs_as_in_the_table() -> None:
    assert [
        row for row in tables.section("messages.md", "## Topics").splitlines() if row.startswith("| `")
    ] == (tables.topic_rows())


@pytest.mark.parametrize("name", ["Header", *TOPICS])
def test_every_message_field_stands_in_the_docs_with_its_type(name: str) -> None:
    kind = m.Message if name == "Header" else TOPICS[name].message
    described = [
        row.split(" | ")[:2]
        for row in tables.section("messages.md", f"## {name}").splitlines()
        if row.startswith("| `")
    ]
    assert described == [[f"| `{field}`", form] for field, form in tables.message_fields(kind).items()]


@pytest.mark.parametrize("heading", tables.MISSION_TABLES)
def test_every_key_of_a_mission_stands_in_the_docs(heading: str) -> None:
    text = tables.section("mission.md", heading)
    for row in tables.key_rows(tables.MISSION_TABLES[heading], nested=False):
        assert row in text, f"docs/mission.md, {heading}: no row that begins with\n{row}"


@pytest.mark.parametrize(("group", "kind"), tables.our_kinds())
def test_every_key_of_a_kind_stands_in_the_docs(group: str, kind: str) -> None:
    heading = f"### {group[:-1]} `{kind}`"
    text = tables.section("mission.md", heading)
    rows = tables.own_rows(group, kind)
    for row in rows:
        assert row in text, f"docs/mission.md, {heading}: no row that begins with\n{row}"
    assert text.count("\n| `") == len(rows), f"docs/mission.md, {heading}: a key that is no more"


def test_every_dependency_stands_in_the_docs_with_its_reason() -> None:
    page = (tables.ROOT / "docs" / "dependencies.md").read_text()
    listed = {row.split("`")[1] for row in page.splitlines() if row.startswith("| `")}
    assert listed == set(tables.dependencies())
