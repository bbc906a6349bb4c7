"""The index: one SQLite file in the folder of the archive.

It is made again whenever it is missing, damaged or of another version. Several processes may update it at once: each
change is a short transaction with the same content in every process. A process that is killed leaves the index as it
was after the last transaction. If the folder cannot be written, the index is in memory, starting from the file if there
is one.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from arm_archive.entries import COLUMNS, NUMBERS, Entry
from arm_archive.folder import RACY, Found
from arm_io import InputError

INDEX = "armscope-archive.sqlite"
APPLICATION = 0x61726D73
"""application_id in the header of the file: "arms". A file with another number is never changed."""
VERSION = 1
"""Version of the tables; an index with another version is made again."""
PATIENCE = 30.0
"""s, maximum time that a transaction waits for those of other processes."""

_SCHEMA = f"""
CREATE TABLE entry (path TEXT PRIMARY KEY, stamp TEXT NOT NULL, racy INTEGER NOT NULL,
    {", ".join(f"{name} {NUMBERS.get(name, 'TEXT')}" for name in COLUMNS if name != "path")}) WITHOUT ROWID;
CREATE TABLE parameter (path TEXT NOT NULL, place INTEGER NOT NULL, name TEXT NOT NULL, value REAL NOT NULL, std REAL,
    unit TEXT NOT NULL, PRIMARY KEY (path, place)) WITHOUT ROWID;
CREATE INDEX parameter_by_name ON parameter (name);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
"""
_PICTURES = "CREATE TABLE IF NOT EXISTS picture (path TEXT PRIMARY KEY, stamp TEXT NOT NULL, svg TEXT) WITHOUT ROWID"
PICTURE = 1
"""Version of the pictures; pictures of another version are drawn again."""


class Index:
    """An open index. ``notes``: sentences that say why it is not the file in the folder, or why it was made again."""

    def __init__(self, connection: sqlite3.Connection, notes: Sequence[str] = ()) -> None:
        self._connection = connection
        self.notes = tuple(notes)

    def stamps(self) -> dict[str, str]:
        """Path -> stamp of the indexed file; "" if the file may have changed without a change of its time."""
        rows = self._connection.execute("SELECT path, CASE racy WHEN 0 THEN stamp ELSE '' END FROM entry")
        return dict(rows.fetchall())

    def put(self, read: Iterable[tuple[Found, Entry, int]]) -> None:
        """Adds or replaces entries in one transaction. The number of each: time when reading began, ns since 1970."""
        with self._transaction() as connection:
            for found, entry, began in read:
                _forget(connection, [found.path])
                values = [getattr(entry, name) for name in COLUMNS]
                marks = ", ".join("?" * (len(COLUMNS) + 2))
                connection.execute(
                    f"INSERT INTO entry (stamp, racy, {', '.join(COLUMNS)}) VALUES ({marks})",
                    [found.stamp, int(found.changed > began - RACY), *values],
                )
                connection.executemany(
                    "INSERT INTO parameter VALUES (?, ?, ?, ?, ?, ?)",
                    [(entry.path, k, p.name, p.value, p.std, p.unit) for k, p in enumerate(entry.parameters)],
                )

    def forget(self, paths: Sequence[str]) -> None:
        """Removes the entries of files that are gone."""
        with self._transaction() as connection:
            _forget(connection, paths)

    def rows(self, query: str, values: Sequence[object] = ()) -> list[dict[str, Any]]:
        """The rows of a query, each as a dictionary."""
        cursor = self._connection.execute(query, list(values))
        names = [item[0] for item in cursor.description]
        return [dict(zip(names, row)) for row in cursor.fetchall()]

    def picture(self, path: str) -> tuple[str | None] | None:
        """The stored picture of an entry; (None,): it has no picture; None: none is stored for the present file."""
        found = self._connection.execute(
            "SELECT svg FROM picture JOIN entry USING (path) "
            "WHERE path = ? AND picture.stamp = ? || entry.stamp AND NOT racy",
            [path, f"{PICTURE} "],
        ).fetchone()
        return None if found is None else (found[0],)

    def keep_picture(self, path: str, svg: str | None) -> None:
        """Stores the picture of a file in its indexed state."""
        with self._transaction() as connection:
            connection.execute(
                "INSERT OR REPLACE INTO picture SELECT path, ? || stamp, ? FROM entry WHERE path = ?",
                [f"{PICTURE} ", svg, path],
            )

    def close(self) -> None:
        self._connection.close()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield self._connection
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")


def _forget(connection: sqlite3.Connection, paths: Sequence[str]) -> None:
    for table in ("entry", "parameter", "picture"):
        connection.executemany(f"DELETE FROM {table} WHERE path = ?", [(path,) for path in paths])


def index_in_memory(folder: Path, why: str) -> Index:
    """An index in memory, starting from the one in the folder if that can be read."""
    file = folder / INDEX
    return Index(_in_memory(file), [f"{file}: cannot be written ({why}); what is read now is not kept"])


def open_index(folder: Path) -> Index:
    """Opens the index of a folder; makes it again if it is damaged, in memory if the folder cannot be written.

    InputError if the file of that name belongs to another program.
    """
    file = folder / INDEX
    notes: list[str] = []
    for attempt in (1, 2):
        try:
            return Index(_writable(file), notes)
        except sqlite3.OperationalError as error:
            return index_in_memory(folder, str(error))
        except sqlite3.DatabaseError as error:
            if attempt == 2:
                raise InputError(file, f"cannot be made again: {error}; delete it") from None
            notes.append(f"{file}: is damaged ({error}); it is made again")
            for ending in ("", "-journal"):
                with suppress(OSError):
                    Path(f"{file}{ending}").unlink(missing_ok=True)
    raise AssertionError  # the second attempt returns or raises


def _writable(file: Path) -> sqlite3.Connection:
    """Raises sqlite3.OperationalError if the file cannot be written, another DatabaseError if it is damaged."""
    connection = sqlite3.connect(file, timeout=PATIENCE, isolation_level=None)
    try:
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute("BEGIN IMMEDIATE")
        application, version, tables = _identity(connection)
        if tables and application != APPLICATION:
            raise InputError(file, "is a database of another program; must be absent, or the index of an archive")
        if version != VERSION or not _sound(connection):
            for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
                connection.execute(f'DROP TABLE "{name}"')
            for statement in _SCHEMA.split(";"):
                connection.execute(statement)
        connection.execute(_PICTURES)
        connection.execute("COMMIT")
        return connection
    except BaseException:
        connection.close()
        raise


def _identity(connection: sqlite3.Connection) -> tuple[int, int, int]:
    """application_id, user_version and the number of tables."""
    return tuple(
        int(connection.execute(query).fetchone()[0])
        for query in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master")
    )  # type: ignore[return-value]


def _sound(connection: sqlite3.Connection) -> bool:
    """True; raises sqlite3.DatabaseError if the file is damaged."""
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise sqlite3.DatabaseError(str(found))
    return True


def _in_memory(file: Path) -> sqlite3.Connection:
    """A copy of the file in memory if it is an undamaged index of armscope; else an empty index."""
    memory = sqlite3.connect(":memory:", isolation_level=None)
    try:
        with closing(sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=PATIENCE)) as kept:
            if _identity(kept)[:2] == (APPLICATION, VERSION) and _sound(kept):
                kept.backup(memory)
                memory.execute(_PICTURES)
                return memory
    except sqlite3.DatabaseError:
        memory = sqlite3.connect(":memory:", isolation_level=None)
    memory.executescript(f"{_SCHEMA};{_PICTURES}")
    return memory
