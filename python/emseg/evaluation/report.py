"""What an evaluation found: rows of figures beside the published ones, as text, JSON, CSV and HTML."""

from __future__ import annotations

import base64
import csv
import html
import json
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import Template
from typing import Any, Final

import numpy as np

from emseg.evaluation.protocols import PROTOCOLS, Figure
from emseg.evaluation.published import UNCONFIRMED, published_for
from emseg.evaluation.views import View
from emseg.writers import write_png

__all__ = ["OURS", "Row", "merged_rows", "text_table", "write_reports"]

OURS: Final = "emseg"
ALL: Final = ""


@dataclass(frozen=True)
class Row:
    """One figure: by whom, over what, mean over the items where it is defined, and how many were skipped."""

    protocol: str
    name: str
    group: str
    method: str
    value: float | None
    items: int | None
    skipped: int | None
    source: str


def merged_rows(dataset: str, figures: Iterable[tuple[str, Figure]]) -> list[Row]:
    """Our figures, (group, figure) a recording, over each group and over all, beside the published ones."""
    gathered: dict[tuple[str, str, str], list[float]] = {}
    for group, figure in figures:
        for key in dict.fromkeys((group, ALL)):
            gathered.setdefault((figure.protocol, figure.name, key), []).extend(figure.values)
    ours = [_summary(*key, values) for key, values in gathered.items()]
    theirs = [
        Row(
            figure.protocol,
            figure.name,
            figure.group,
            figure.method,
            figure.value,
            None,
            None,
            figure.source + ("" if figure.confirmed else UNCONFIRMED),
        )
        for figure in published_for(dataset)
    ]
    order = list(PROTOCOLS)
    names = list(dict.fromkeys(row.name for row in [*ours, *theirs]))
    rows = [*ours, *theirs]
    return sorted(
        rows,
        key=lambda row: (order.index(row.protocol), names.index(row.name), row.group, row.method != OURS),
    )


def _summary(protocol: str, name: str, group: str, values: Sequence[float]) -> Row:
    array = np.array(values, dtype=np.float64)
    known = array[~np.isnan(array)]
    value = float(known.mean()) if known.size else None
    return Row(protocol, name, group, OURS, value, int(known.size), int(array.size - known.size), "this run")


RECORDING_HEADING: Final = ("recording", "events", "windows", "s", "CPU s", "ms a window")
FACTS: Final = {
    "version": "version",
    "commit": "commit",
    "settings_name": "settings",
    "seconds": "seconds of each recording",
    "machine": "machine",
    "date": "date",
    "peak_mb": "peak memory, MB",
}
"""Of an evaluation, shown at the head of the page, by what they are called there."""
HEADING: Final = ("figure", "over", "method", "value", "of", "skipped", "source")


def shown_rows(rows: Sequence[Row]) -> list[Row]:
    """Without published figures of groups of which there is nothing of ours to stand beside."""
    ours = {(row.protocol, row.group) for row in rows if row.method == OURS}
    scored = {protocol for protocol, _ in ours}
    return [
        row
        for row in rows
        if row.group == ALL or row.protocol not in scored or (row.protocol, row.group) in ours
    ]


def _sources(rows: Sequence[Row]) -> dict[str, str]:
    """The sources of published figures, numbered as the tables cite them."""
    cited = dict.fromkeys(row.source for row in rows if row.method != OURS)
    return {source: f"[{k}]" for k, source in enumerate(cited, 1)}


def _cells(row: Row, sources: dict[str, str]) -> tuple[str, ...]:
    item = PROTOCOLS[row.protocol].item
    plural = {"box": "boxes"}.get(item, f"{item}s")
    return (
        row.name,
        row.group or "all",
        row.method,
        "–" if row.value is None else f"{row.value:.3f}",
        "–" if row.items is None else f"{row.items} {item if row.items == 1 else plural}",
        "–" if row.skipped is None else str(row.skipped),
        sources.get(row.source, row.source),
    )


def text_table(rows: Sequence[Row]) -> str:
    """The rows to be shown in columns, a heading for each protocol, and the published figures' sources."""
    rows = shown_rows(rows)
    sources = _sources(rows)
    cells = [_cells(row, sources) for row in rows]
    widths = [max(map(len, column)) for column in zip(HEADING, *cells, strict=True)]
    lines: list[str] = []
    last = ""
    for row, line in zip(rows, cells, strict=True):
        if row.protocol != last:
            last = row.protocol
            title = f"{row.protocol}: {PROTOCOLS[row.protocol].title}"
            lines += [*([""] if lines else []), title, _aligned(HEADING, widths)]
        lines.append(_aligned(line, widths))
    if sources:
        lines += ["", "sources", *(f"  {number:4} {source}" for source, number in sources.items())]
    return "\n".join(lines)


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> str:
    numbers = (3, 4, 5)
    padded = (
        cell.rjust(width) if k in numbers else cell.ljust(width)
        for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return "  " + "  ".join(padded).rstrip()


def write_reports(
    folder: Path,
    about: dict[str, Any],
    rows: Sequence[Row],
    recordings: Sequence[dict[str, Any]],
    views: Sequence[View],
) -> list[Path]:
    """Write evaluation.json, .csv and .html, the pictures in it, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"evaluation.{suffix}" for suffix in ("json", "csv", "html")]
    content = {**about, "figures": [asdict(row) for row in rows], "recordings": list(recordings)}
    files[0].write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    with files[1].open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["dataset", *Row.__dataclass_fields__])
        writer.writerows([about["dataset"], *asdict(row).values()] for row in rows)
    files[2].write_text(_page(about, rows, recordings, views), encoding="utf-8")
    return files


# --- the page ----------------------------------------------------------------------------------------------

_PAGE: Final = Template(
    """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>emseg on $dataset</title>
<style>
body { font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; margin: .5em 0 2em; }
th, td { padding: .15em .8em; text-align: left; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.ours { background: #eef4fb; font-weight: bold; }
figure { margin: 1em 0; } img { max-width: 100%; } figcaption, .about { color: #555; }
</style></head><body>
<h1>emseg on $dataset</h1>
<p class="about">$about</p>
$tables
$sources
<h2>Windows</h2>
<p>Truth left, labels right, the worst first; grey is the background, a colour an object. The score is the
mean of moving and object IoU, or the share of the annotated boxes that is found.</p>
$figures
<h2>Recordings</h2>
$recordings
</body></html>
"""
)


def _page(
    about: dict[str, Any], rows: Sequence[Row], recordings: Sequence[dict[str, Any]], views: Sequence[View]
) -> str:
    tables = []
    shown = shown_rows(rows)
    sources = _sources(shown)
    for protocol in dict.fromkeys(row.protocol for row in shown):
        own = [row for row in shown if row.protocol == protocol]
        tables.append(f"<h2>{html.escape(protocol)}</h2><p>{html.escape(PROTOCOLS[protocol].title)}</p>")
        body = [(_cells(row, sources), "ours" if row.method == OURS else "") for row in own]
        tables.append(_table(HEADING, body, numbers=(3, 4, 5)))
    listed = [
        (
            (
                r["name"],
                str(r["events"]),
                str(r["windows"]),
                f"{r['seconds']:.2f}",
                f"{r['cpu_s']:.2f}",
                f"{r['ms_a_window']:.0f}",
            ),
            "",
        )
        for r in recordings
    ]
    facts = "; ".join(f"{name} {about[key]}" for key, name in FACTS.items() if about.get(key) is not None)
    cited = "".join(f"<li>{html.escape(source)}</li>" for source in sources)
    return _PAGE.substitute(
        dataset=html.escape(str(about["dataset"])),
        about=html.escape(facts),
        tables="\n".join(tables),
        sources=f"<h2>Sources</h2><ol>{cited}</ol>" if cited else "",
        figures="\n".join(_figure(view) for view in views),
        recordings=_table(RECORDING_HEADING, listed, numbers=(1, 2, 3, 4, 5)),
    )


def _table(
    heading: Sequence[str], body: Iterable[tuple[Sequence[str], str]], *, numbers: Sequence[int]
) -> str:
    lines = ["<table><tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in heading) + "</tr>"]
    for cells, kind in body:
        marked = (
            f'<td class="number">{html.escape(cell)}</td>'
            if k in numbers
            else f"<td>{html.escape(cell)}</td>"
            for k, cell in enumerate(cells)
        )
        lines.append(f'<tr class="{kind}">' + "".join(marked) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _figure(view: View) -> str:
    caption = html.escape(view.caption)
    data = base64.b64encode(_png(view)).decode("ascii")
    image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _png(view: View) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "view.png"
        write_png(path, view.picture)
        return path.read_bytes()
