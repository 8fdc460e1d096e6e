# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of results: what it shows, what it escapes, and how much."""

from convseq_ros.evaluation.plots import new_figure, svg
from convseq_ros.evaluation.report.page import MOST_PICTURES, Pair, Section, write_page
from convseq_ros.evaluation.report.results import nearest
import numpy as np
import pytest

JPEG = b'\xff\xd8\xff a picture'


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a page of one section, and returns its text."""
    pytest.importorskip('jinja2')

    def write(**section):
        sections = [Section('a <section> & $named', **section)]
        write_page(tmp_path / 'page.html', 'a <title>', 'facts', sections, {'a <run>': '{"a": 1}'})
        return (tmp_path / 'page.html').read_text('utf-8')

    return write


def test_texts_are_escaped_and_nothing_is_loaded(written):
    text = written(pairs={'<kind>': [Pair('a <caption>', (JPEG, b''))]})
    for word in ('title', 'section', 'kind', 'caption', 'run'):
        assert f'<{word}>' not in text.partition('</head>')[2] and f'&lt;{word}&gt;' in text
    assert 'a &lt;section&gt; &amp; $named' in text
    assert "default-src 'none'" in text and '<script' not in text
    assert text.count('alt="no picture"') == 1


def test_of_many_pairs_evenly_some_are_shown_and_of_few_all(written):
    many = [Pair(f'number {at}.', (JPEG,) * 3) for at in range(1000)]
    text = written(pairs={'right': many, 'wrong': many[:3], 'none': []})
    shown = MOST_PICTURES // 6
    assert f'right: 1000, of which {shown} are here, evenly' in text and 'wrong: 3<' in text
    assert text.count('class="pair"') == shown + 3 and 'none' not in text.partition('</head>')[2]
    assert 'number 0.' in text and 'number 999.' in text


def test_a_figure_is_the_same_each_time():
    pytest.importorskip('matplotlib')

    def drawn():
        (figure := new_figure(4, 3)).add_subplot().plot([0, 1], [1, 0], label='of $a$')
        return svg(figure)

    assert drawn() == drawn() and '<svg' in drawn()


def test_the_truth_that_is_shown_is_nearest_to_the_answer():
    right = np.isin(np.arange(20), [2, 3, 10, 11])
    assert [nearest(right, best) for best in (5, 19, 10)] == [3, 11, 10]
    assert nearest(np.zeros(20, bool), 5) is None
