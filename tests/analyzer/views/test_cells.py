"""Fields that several tables share."""

from __future__ import annotations

from analyzer.views.cells import MAX_LABEL_COLUMNS, bus_field


def test_the_column_of_buses() -> None:
    """As wide as its names, which are shortened; a bus that came later is shown as it is called."""
    field = bus_field(["plant/pumps.log", "plant/fans.log"], str)
    assert [field.cell(name) for name in ("plant/pumps.log", "later")] == ["pumps.log", "later"]
    assert field.head.min_width == len("pumps.log")
    assert bus_field(["a" * 80, "b"], str).head.min_width == MAX_LABEL_COLUMNS


def test_a_bus_file_without_buses_yet() -> None:
    """A screen is drawn before the first bus is known."""
    field = bus_field([], str)
    assert (field.head.min_width, field.cell("line")) == (0, "line")
