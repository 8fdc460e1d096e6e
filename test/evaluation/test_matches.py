# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page of what was matched: its size, what it shows, and that it works in a browser."""

import base64
import re

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Frame
from convseq_ros.evaluation.report.above import drawn_above
from convseq_ros.evaluation.report.matches import MatchPage, PAGE
from convseq_ros.evaluation.report.pairs import picture_of
import numpy as np
from pictures import scene
import pytest
from web_page import data_of, shown

COLORS = {'accepted': '#2f9e44', 'weak': '#ffd43b', 'recent': '#4dabf7'}
STRIP = 'Height: confidence.'
# Clicks at 72 % of the strip, on frame 4 that has no pair, at its end, and on an arc.
STEPS = """
const strip_ = byId('strip'), box = strip_.getBoundingClientRect(), answers = [];
const tell = () => answers.push(byId('verdict').textContent.replace('<frame> ', ''));
for (const share of [.72, .99]) {
  strip_.dispatchEvent(new MouseEvent('click', { clientX: box.x + box.width * share }));
  tell();
}
document.querySelector('.arc').dispatchEvent(new Event('click', { bubbles: true }));
tell();
document.querySelector('[data-mark=region]').click();
document.title = answers.join(' ');
"""


def test_a_page_of_5000_frames_stays_below_20_mb_with_pairs_evenly(tmp_path):
    random, page = np.random.default_rng(0), MatchPage(5000, 'accepted', COLORS)

    def pair():  # thumbnails of 128 px take 2 to 3 kB; as many marks as are drawn
        return ('frame', 'here', 'there'), tuple(map(random.bytes, (3000, 3000, 600, 400)))

    for at in range(5000):
        page.add('accepted' if at % 5 else 'weak', 0.5, at / 10, pair)
    page.write(tmp_path / 'page.html', 'title', ['5000 frames'], '', {}, STRIP)
    assert 17e6 < (tmp_path / 'page.html').stat().st_size < 20e6
    data = data_of(tmp_path / 'page.html')
    rows = data['runs'][0]['rows']
    for kind, count in (('accepted', 4000), ('weak', 1000)):
        positions = [row[-1] for row in rows if row[0] == kind]
        assert len(positions) > count / 5
        assert max(np.diff(positions)) <= 5 * min(np.diff(positions))
        assert positions[0] < 5 and positions[-1] > 4980
    assert len(data['strip']['kinds']) == 5000
    assert f'{len(rows)} of 5000 pairs are here' in (tmp_path / 'page.html').read_text('utf-8')


@pytest.fixture
def page(tmp_path):
    """Return a small page: frames 1, 3, ... are accepted, and frame 4 has no pair."""
    pictures = [scene(place) for place in range(3)]
    jpegs = [picture_of(mapped(picture), 0, PAGE.wide_px) for picture in pictures]
    page = MatchPage(6, 'accepted', COLORS)
    marks = bytes([0, 51, 255, 102]), bytes([102, 153, 204, 51])
    for at in range(6):
        kind = 'accepted' if at % 2 else 'weak'
        if at == 4:
            page.add('recent', None, at / 10)
            continue
        texts = f'<frame> {at}', f'Frame {at}', f'Place {at}'
        pair = jpegs[at % 3], jpegs[(at + 1) % 3], *marks
        page.add(kind, at / 10, at / 10, lambda texts=texts, pair=pair: (texts, pair))
    above = drawn_above(
        [('a <map>', np.array([[0.0, 0.0], [np.nan, np.nan], [10.0, 0.0]]))],
        [(3, COLORS['accepted'], np.array([[1.0, 0.0], [9.0, 0.0]]))],
    )
    path = tmp_path / 'page.html'
    page.write(path, 'a <title>', ['6 frames'], above, {}, STRIP, 's', 0.9)
    return path


def mapped(gray, thumbnail_px=128, image_px=0):
    """Return a map of one picture."""
    reference_map = ReferenceMap()
    reference_map.add_frame(
        Frame(0, gray), describe(gray, EncodingConfig()), thumbnail_px, image_px, 0
    )
    return reference_map


def test_each_pair_is_on_a_small_page_and_each_picture_once(page):
    data = data_of(page)
    rows = data['runs'][0]['rows']
    assert [row[0] for row in rows] == ['weak', 'accepted'] * 2 + ['accepted']
    assert [row[-1] for row in rows] == [0, 1, 2, 3, 5]
    assert [row[4:6] for row in rows] == [[0, 1], [1, 2], [2, 0], [0, 1], [2, 0]]
    assert len(data['pictures']) == 3
    assert base64.b64decode(rows[0][6]) == bytes([0, 51, 255, 102])
    assert data['strip']['kinds'] == [1, 0, 1, 0, 2, 0]
    assert data['strip']['heights'] == [0, 10, 20, 30, None, 50]
    assert data['strip']['threshold'] == 90
    text = page.read_text('utf-8')
    assert 'a &lt;title&gt;' in text and 'a &lt;map&gt;' in text and '<frame>' not in text
    assert 'To keep this page small' not in text


def test_an_arc_leads_from_the_frame_to_its_place(page):
    path = re.search(r'data-frame="3" d="M(.*?)Q(.*?)"', page.read_text('utf-8'))
    start, middle, end = (tuple(map(float, point.split())) for point in (
        path[1], *re.findall(r'\S+ \S+', path[2])))  # fmt: skip
    # Ten metres are 940 wide, from 30 on; y points up, so the arc bends up to the left.
    assert start == (124.0, end[1]) and end[0] == 876.0
    assert middle[0] == 500.0 and middle[1] == pytest.approx(start[1] - 0.2 * 752, abs=0.1)
    assert drawn_above([('none', np.full((3, 2), np.nan))], []) == ''


def test_a_place_is_shown_by_its_kept_image_or_else_its_thumbnail():
    gray = scene(1, size=(640, 480))
    small = mapped(gray)
    assert picture_of(small, 0, 240) == small.thumbnail(0)
    assert decode_jpeg(picture_of(small, 0, 64)).shape == (48, 64)
    assert decode_jpeg(picture_of(mapped(gray, 128, 640), 0, 240)).shape == (180, 240)
    assert picture_of(mapped(gray, 0), 0, 240) == b''


def test_a_click_on_strip_or_arc_shows_the_nearest_pair_with_its_marks(page):
    first = shown(page).partition('<noscript>')[0]
    assert 'id="verdict" aria-live="polite" class="accepted"' in first
    assert '&lt;frame&gt; 1' in first
    assert len(re.findall('<rect class="region"', first)) == 2
    # Across and down in the first picture, then in the second, which is 128 px wide, 96 high.
    circles = re.findall(r'<circle class="keypoint" cx="([^"]*)" cy="([^"]*)"', first)
    centres = [float(number) for circle in circles for number in circle]
    assert centres == pytest.approx([51.2, 57.6, 102.4, 19.2])
    clicked = shown(page, STEPS).partition('<noscript>')[0]
    assert re.search(r'<title>(.*?)</title>', clicked)[1] == '3 5 3'
    assert 'class="arc on"' in clicked and '<section id="pairs" class="no-region">' in clicked
