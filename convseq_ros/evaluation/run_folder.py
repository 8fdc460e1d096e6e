# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes and reads the folder of `convseq evaluate --output DIR`.

::

    DIR/report.html               tables, figures and pairs of pictures
    DIR/summary.csv               one row per set and method
    DIR/<set>/<method>/frames.csv the result table's columns and those of `EXTRA_COLUMNS`
    DIR/<set>/<method>/summary.json
    DIR/<set>/<method>/scores.npy float32 (Q, R), pair scores, higher is more similar, NaN where a
                                  pair was not scored; absent with half of the map removed

With half of the map removed the set is called `<set>-open`. It has three rows per query, one for
each kept half. Its indices are those of the full map.
"""

from collections.abc import Iterable, Mapping, Sequence
import json
from pathlib import Path
from typing import Any

from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import load, SourceError
from convseq_ros.evaluation.protocols import OPEN, Outcome, VERSION
from convseq_ros.evaluation.scorecard import margin, Summary, Verdicts
from convseq_ros.io.files import read_text
from convseq_ros.io.output_file import OutputFile
from convseq_ros.io.regular_file import complete_or_absent, write_text
import numpy as np

REPORT, _TABLE = 'report.html', 'summary.csv'
# What results of a set need in common, and how it is called if it differs.
_SAME = {
    'images': 'other images',
    'truth': 'another truth, or part of the map,',
    'criterion': 'another criterion',
}
EXTRA_COLUMNS = ('correct', 'known', 'slip', 'margin', 'entropy', 'half')


def refuse_others(option: str, folder: Path) -> None:
    """Raise a ConfigError if a folder has a page, or a table without one, of somebody else."""
    present = [folder / name for name in (REPORT, _TABLE) if (folder / name).exists()]
    for path in present[:1]:
        OutputFile(option, path).refuse()


def write_run(folder: Path, outcome: Outcome, verdicts: Verdicts, summary: Summary) -> None:
    """Write the answers of a method, its pair scores, and last its summary."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / 'frames.csv', _frames(outcome, verdicts).to_csv(index=False))
    if outcome.protocol != OPEN:
        with complete_or_absent(folder / 'scores.npy') as part:
            np.save(part, outcome.pairs.scores.astype(np.float32), allow_pickle=False)
    write_text(folder / 'summary.json', json.dumps(summary, indent=1) + '\n')


def write_summary_table(folder: Path, summaries: Sequence[Summary]) -> None:
    """Write summary.csv, every figure that is a single number or text."""
    plain = (
        {name: one for name, one in summary.items() if not isinstance(one, Mapping | list)}
        for summary in summaries
    )
    table = load('pandas', 'evaluation').DataFrame(plain)
    write_text(folder / _TABLE, table.to_csv(index=False))


def _frames(outcome: Outcome, verdicts: Verdicts) -> Any:
    """Return a row per answer, as a pandas table."""
    durations_ms = outcome.durations_ms or [0.0] * len(outcome.matches)
    query, margins = outcome.query, map(margin, outcome.matches)
    sources = [query.names[match.query_index] for match in outcome.matches]
    answers = [*map(row, outcome.matches, durations_ms, sources)]
    table = load('pandas', 'evaluation').DataFrame(answers, columns=COLUMNS, dtype=object)
    if not outcome.durations_ms:
        table['duration_ms'] = ''
    for name in ('correct', 'known', 'slip'):
        table[name] = getattr(verdicts, name).astype(int)
    table['margin'] = ['' if np.isnan(one) else f'{one:.7f}' for one in margins]
    entropies = [
        f'{one.entropy:.6f}' if readable else ''
        for one, readable in zip(query.descriptors, query.readable, strict=True)
    ]
    table['entropy'] = [entropies[match.query_index] for match in outcome.matches]
    table['half'] = outcome.halves
    return table


def read_summaries(paths: Iterable[Path], reading: ReadingConfig) -> list[Summary]:
    """Return summaries of folders or files, by set; SourceError if they cannot be compared."""
    by_set: dict[str, list[Summary]] = {}
    for path in paths:
        files = sorted(path.glob('*/*/summary.json')) if path.is_dir() else [path]
        if not files:
            raise SourceError(f'{path}: no results of `convseq evaluate` in this folder')
        for file in files:
            summary = _read_summary(file, reading)
            (of_set := by_set.setdefault(str(summary['set']), [])).append(summary)
            for key, what in _SAME.items():
                if summary.get(key) != of_set[0].get(key):
                    raise SourceError(
                        f'{file}: {summary["set"]} has {what} than in the results before; '
                        'compare figures of the same'
                    )
    return [summary for of_set in by_set.values() for summary in of_set]


def _read_summary(path: Path, reading: ReadingConfig) -> Summary:
    try:
        summary = dict(json.loads(read_text(path, 'a JSON file', reading)))
        version, _, _ = summary['protocol_version'], summary['set'], summary['method']
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise SourceError(f'{path}: no summary of `convseq evaluate` ({error})') from None
    if version != VERSION:
        raise SourceError(
            f'{path}: protocol version {version}, and this program has {VERSION}; '
            'evaluate again with one program'
        )
    return summary
