"""The figure of where fundamental solutions fail, and what the table behind it says."""

import pytest

from warp_immersed.fundamental_solutions import TABLE_COLUMNS, failure_table

pytest.importorskip("matplotlib")


def test_figure_and_table_are_written(tmp_path, monkeypatch) -> None:
    from warp_immersed.charts import added_mass_failures
    from warp_immersed.charts.figures import Request

    rows = failure_table(aspect_ratios=(1, 50), subdivisions=(2,), offsets=(0.5, 1.0))
    monkeypatch.setattr(added_mass_failures, "failure_table", lambda: rows)
    added_mass_failures.chart(Request(tmp_path / "failures.png"))
    assert (tmp_path / "failures.png").read_bytes().startswith(b"\x89PNG")
    table = (tmp_path / "failures.csv").read_text().splitlines()
    assert table[0] == ",".join(TABLE_COLUMNS)
    assert len(table) == 5


def test_no_offset_saves_the_method_on_thin_bodies() -> None:
    rows = failure_table(aspect_ratios=(1, 50), subdivisions=(2,))
    error = TABLE_COLUMNS[6]
    assert min(abs(row[error]) for row in rows if row[TABLE_COLUMNS[0]] == 1) < 1.0, "the sphere is easy"
    assert min(abs(row[error]) for row in rows if row[TABLE_COLUMNS[0]] == 50) > 50.0
