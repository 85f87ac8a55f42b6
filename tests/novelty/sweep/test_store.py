"""The store: whole shards or none, the latest attempt counts, damage is noticed and set aside."""

import errno

import duckdb
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest

from novelty.errors import InputError
from novelty.sweep.folder import SweepFolder
from novelty.sweep.rows import COLUMNS, FAILED, OK, SCHEMA, as_table
from novelty.sweep.store import RowStore, StoreError, read_rows


def row(number: int, status: str = OK, attempt: int = 1, **values: object) -> dict[str, object]:
    identity = {"key": f"key{number}", "data": "simulated", "pair": f"pair{number}", "repetition": 0}
    finished = pd.Timestamp("2026-01-01", tz="UTC") + pd.Timedelta(seconds=number, milliseconds=attempt)
    return (
        identity
        | {"configuration": "{}", "status": status, "attempt": attempt, "finished": finished}
        | values
    )


@pytest.fixture
def folder(tmp_path):
    return SweepFolder(tmp_path)


def test_rows_come_back_in_the_order_in_which_they_were_finished(folder):
    RowStore(folder).write([row(2), row(1)])
    RowStore(folder).write([row(0, kappa=0.5)])
    table = read_rows(folder.root)
    assert table.schema.equals(SCHEMA)
    assert table["pair"].to_pylist() == ["pair0", "pair1", "pair2"]
    assert table["kappa"].to_pylist() == [0.5, None, None]


def test_every_column_says_what_it_is(folder):
    shard = RowStore(folder).write([row(0)])
    stored = pq.read_schema(shard)
    assert [stored.field(c.name).metadata[b"description"].decode() for c in COLUMNS] == [
        c.description for c in COLUMNS
    ]


def test_undefined_values_become_null():
    table = as_table([{"key": "a", "kappa": float("nan"), "reference_mdl_path": [1.0, float("nan")]}])
    assert table["kappa"].to_pylist() == [None]
    assert table["reference_mdl_path"].to_pylist() == [[1.0, None]]


def test_a_run_counts_once_and_its_last_attempt_is_the_one(folder):
    RowStore(folder).write([row(0, FAILED)])
    RowStore(folder).write([row(0, OK, attempt=2)])
    RowStore(folder).write([row(0, OK, attempt=2)])
    assert read_rows(folder.root)["status"].to_pylist() == [OK]
    assert RowStore(folder).finished["key0"].attempt == 2


def test_two_stores_in_one_folder_see_each_others_rows(folder):
    one, other = RowStore(folder), RowStore(folder)
    one.write([row(0)])
    other.write([row(1)])
    one.refresh()
    assert set(one.finished) == {"key0", "key1"}


@pytest.mark.parametrize("damage", ["cut short", "bit flipped", "empty"])
def test_a_damaged_shard_is_set_aside_and_the_others_survive(folder, damage):
    store = RowStore(folder)
    store.write([row(0)])
    shard = store.write([row(n, message="x" * 50) for n in range(1, 50)])
    content = bytearray(shard.read_bytes())
    place = pq.read_metadata(shard).row_group(0).column(0).data_page_offset + 60
    content[place] ^= 1
    shard.write_bytes(
        {"cut short": content[: len(content) // 2], "bit flipped": content, "empty": b""}[damage]
    )
    assert len(read_rows(folder.root)) == 1
    again = RowStore(folder)
    assert set(again.finished) == {"key0"}
    assert [path.name for path in again.damaged] == [shard.name]
    assert (folder.damaged / shard.name).exists()
    assert not shard.exists()


def test_a_full_disk_is_said_and_leaves_no_half_shard(folder, monkeypatch):
    store = RowStore(folder)
    store.write([row(0)])

    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(StoreError, match=r"No space left.*safe.*same command"):
        store.write([row(1)])
    assert len(list(folder.rows.iterdir())) == 1
    assert set(store.finished) == {"key0"}


def test_the_rows_are_readable_without_novelty(folder):
    store = RowStore(folder)
    store.write([row(0, kappa=0.5)])
    store.write([row(1, kappa=1.0)])
    pattern = f"{folder.rows}/*.parquet"
    assert pd.read_parquet(folder.rows)["kappa"].mean() == 0.75
    assert pl.read_parquet(pattern)["kappa"].mean() == 0.75
    assert duckdb.sql(f"select avg(kappa) from '{pattern}'").fetchall() == [(0.75,)]


def test_a_folder_without_rows_is_an_error_that_helps(tmp_path):
    with pytest.raises(InputError, match="there are no rows"):
        read_rows(tmp_path)
