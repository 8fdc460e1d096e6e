# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the size of Python code, in measures that dense lines do not improve.

Usage: python scripts/count.py FILE_OR_FOLDER ... Blank lines, comments and docstrings are not
counted as lines. Fields are annotated names of dataclasses and `@constants`; `constants` are those
of `@constants`. Bare numbers are literals other than 0, 1, -1 and 2, outside `@constants`.
"""

import argparse
import ast
from collections import Counter
import io
from pathlib import Path
import tokenize

SILENT = ('COMMENT', 'NL', 'NEWLINE', 'INDENT', 'DEDENT', 'ENDMARKER')
NO_CODE = {getattr(tokenize, name) for name in SILENT}
RECORDS = {'dataclass', 'constants'}
COLUMNS = ('lines', 'statements', 'fields', 'constants', 'bare numbers')


def decorators(node: ast.ClassDef) -> set[str]:
    """Return the last names of a class's decorators."""
    bare = (one.func if isinstance(one, ast.Call) else one for one in node.decorator_list)
    return {ast.unparse(one).rpartition('.')[2] for one in bare}


def is_docstring(node: ast.AST) -> bool:
    """Return whether a node is a docstring: an expression of text alone."""
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def is_bare(node: ast.AST) -> bool:
    """Return whether a node is a number without a name; the sign of -1 does not matter."""
    value = node.value if isinstance(node, ast.Constant) else None
    return type(value) in (int, float) and value not in (0, 1, 2)


def count(text: str) -> Counter[str]:
    """Return the sizes of a file."""
    tree, counts = ast.parse(text), Counter[str]()
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    docstrings = [node for node in statements if is_docstring(node)]
    silent = {at for node in docstrings for at in range(node.lineno, (node.end_lineno or 0) + 1)}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = (range(one.start[0], one.end[0] + 1) for one in tokens if one.type not in NO_CODE)
    counts['lines'] = len({at for lines in code for at in lines} - silent)
    counts['statements'] = len(statements) - len(docstrings)
    named: set[ast.AST] = set()
    for record in statements:
        if isinstance(record, ast.ClassDef) and (how := decorators(record)) & RECORDS:
            fields = sum(isinstance(node, ast.AnnAssign) for node in record.body)
            counts['fields'] += fields
            if 'constants' in how:
                counts['constants'] += fields
                named.update(ast.walk(record))
    counts['bare numbers'] = sum(is_bare(node) for node in ast.walk(tree) if node not in named)
    return counts


def main() -> None:
    """Count, and print a table."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('paths', type=Path, nargs='+')
    paths, total = parser.parse_args().paths, Counter[str]()
    print('| file | ' + ' | '.join(COLUMNS) + ' |\n|---' + '|---' * len(COLUMNS) + '|')
    for path in (file for at in paths for file in sorted(at.rglob('*.py')) or [at]):
        counts = count(path.read_text(encoding='utf-8'))
        total.update(counts)
        print(f'| {path} | ' + ' | '.join(str(counts[name]) for name in COLUMNS) + ' |')
    print('| total | ' + ' | '.join(str(total[name]) for name in COLUMNS) + ' |')


if __name__ == '__main__':
    main()
