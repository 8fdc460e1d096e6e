# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Methods on small drawn sets and a real one: figures, their folder, and what users bring."""

import csv
import json
import sys

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.config import Config
from convseq_ros.errors import ConfigError, ConvseqError
from convseq_ros.evaluation import bench, methods
from convseq_ros.evaluation.bench import evaluate, Plan
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.methods import KINDS, make_method, parse_method
from convseq_ros.evaluation.query_answers import overridden
from convseq_ros.evaluation.run_folder import EXTRA_COLUMNS
import cv2
import numpy as np
import pytest

for name in ('jinja2', 'matplotlib', 'pandas', 'sklearn'):
    pytest.importorskip(name)

KEYS = {
    'accuracy_matched', 'accuracy_all', 'queries', 'matched', 'recall_at_100_precision', 'auc_pr',
    'false_closures', 'slips', 'mean_k', 'encode_ms', 'frame_ms', 'configuration', 'versions',
    'argv', 'precision_at_100_recall',
}  # fmt: skip


def run(street, quick, output, *methods, files=None, **plan):
    sets = [open_data_set(str(one)) for one in files or [street.file]]
    plan = Plan(methods=methods, argv=('convseq', 'evaluate'), **plan)
    return evaluate(sets, quick, plan, output)


def rows(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_every_method_recognises_an_easy_street(street, quick, tmp_path):
    names = ('convseq', 'convseq k=3', 'cohog', 'seqslam', 'hog')
    summaries = run(street, quick, tmp_path / 'out', *names)
    assert [one['method'] for one in summaries] == [name.replace(' k=', '-k') for name in names]
    for one in summaries:
        assert one['accuracy_matched'] >= 0.9, one['method']
        assert KEYS <= one.keys()
        assert one['recall_at_1'] == one['accuracy_all']
        assert one['recall_at_1'] <= one['recall_at_5'] <= one['recall_at_20']


@pytest.mark.parametrize(('method', 'knows_the_drive'), [
    ('single', False), ('verified', False), ('convseq k=1 matching=coherent', True),
])  # fmt: skip
def test_single_image_methods_give_the_same_scores_in_any_order(
    street, quick, tmp_path, method, knows_the_drive
):
    backwards = street.file.read_text().replace('path: query', 'path: query, backwards: true')
    files = [street.file, street.write(backwards.replace('name: street', 'name: back'), 'b.yaml')]
    ahead, _ = run(street, quick, tmp_path / 'out', f'{method} label=m', files=files)
    assert ahead['accuracy_all'] >= 0.9
    there, again = (
        [row['best_score'] for row in rows(tmp_path / 'out' / name / 'm' / 'frames.csv')]
        for name in ('street', 'back')
    )
    assert (there == again[::-1]) is not knows_the_drive


def test_an_evaluation_folder_holds_consistent_results(street, quick, tmp_path):
    output = tmp_path / 'out'
    run(street, quick, output, 'convseq', 'hog')
    method = output / 'street' / 'convseq'
    frames = rows(method / 'frames.csv')
    assert tuple(frames[0]) == COLUMNS + EXTRA_COLUMNS
    assert [row['query_index'] for row in frames] == [str(index) for index in range(24)]
    assert frames[3]['image'] == '003.png'
    summary = json.loads((method / 'summary.json').read_text())
    assert summary['argv'] == ['convseq', 'evaluate']
    assert summary['configuration']['image_size_px'] == 128
    right = sum(row['correct'] == '1' for row in frames)
    assert summary['accuracy_all'] == right / 24
    assert summary['accuracy_matched'] == right / sum(row['best_index'] != '' for row in frames)
    assert sum(summary['k_distribution'].values()) == summary['matched']
    scores = np.load(method / 'scores.npy', allow_pickle=False)
    assert scores.shape == (24, 24)
    assert scores.dtype == np.float32
    other = json.loads((output / 'street' / 'hog' / 'summary.json').read_text())
    assert 'difference' not in summary and other['difference_from'] == 'convseq'
    gain = other['accuracy_all'] - summary['accuracy_all']
    assert other['difference'] == pytest.approx(gain)
    table = rows(output / 'summary.csv')
    assert [(row['set'], row['method']) for row in table] == [
        ('street', 'convseq'),
        ('street', 'hog'),
    ]
    assert float(table[0]['accuracy_all']) == summary['accuracy_all']
    assert not list(output.rglob('*.part'))


def test_with_half_of_the_map_removed_unknown_places_are_counted_as_such(street, quick, tmp_path):
    summaries = run(street, quick, tmp_path / 'out', 'convseq', 'hog', protocols=('open',))
    assert [one['set'] for one in summaries] == ['street-open', 'street-open']
    for one in summaries:
        assert one['queries'] == 72
        assert one['known'] == 3 * 12 + 4
        assert one['accepted'] == one['accepted_right'] + one['false_closures'] + one['slips']
    always = summaries[1]
    assert always['accepted'] == always['matched']
    assert always['false_closures'] > 20
    assert summaries[0]['false_closures'] < always['false_closures']
    frames = rows(tmp_path / 'out' / 'street-open' / 'hog' / 'frames.csv')
    halves = {'first': range(12), 'last': range(12, 24), 'middle': range(6, 18)}
    for row in frames:
        assert row['best_index'] == '' or int(row['best_index']) in halves[row['half']]


def test_the_first_part_of_the_map_can_be_kept(street, quick, tmp_path):
    (one,) = run(street, quick, tmp_path / 'out', 'convseq', protocols=('open',), keep=0.7)
    assert (one['queries'], one['known']) == (24, 17 + 1)
    assert list(one['frames_to_first_closure']) == ['first']
    frames = rows(tmp_path / 'out' / 'street-open' / 'convseq' / 'frames.csv')
    assert all(int(row['best_index'] or 0) < 17 for row in frames)
    assert one['title'].endswith('first 70% of the map kept')


def test_a_drive_finds_its_own_past(loop, quick, tmp_path):
    for one in run(loop, quick, tmp_path / 'out', 'convseq k=3', 'hog'):
        assert (one['protocol'], one['known']) == ('online', 36)
        assert one['accuracy_matched'] >= 0.8
        for row in rows(tmp_path / 'out' / 'loop' / one['method'] / 'frames.csv'):
            newest = int(row['query_index']) - 20
            assert row['best_index'] == '' or int(row['best_index']) <= newest


def test_frames_that_never_came_into_the_map_keep_their_numbers(loop, quick, tmp_path):
    blank = np.full((128, 128), 90, np.uint8)
    for index in (2, 3, 4):
        cv2.imwrite(str(loop.folder / 'drive' / f'{index:03d}.png'), blank)
    run(loop, quick, tmp_path / 'out', 'cohog keyframe_overlap=0.999 label=cohog')
    found = rows(tmp_path / 'out' / 'loop' / 'cohog' / 'frames.csv')
    assert sum(row['correct'] == '1' for row in found[57:]) >= 5
    scores = np.load(tmp_path / 'out' / 'loop' / 'cohog' / 'scores.npy', allow_pickle=False)
    assert np.isnan(scores[:, 2:5]).all() and np.isfinite(scores[36:, 5]).all()


def test_a_drive_without_revisits_gives_nothing(loop, quick, tmp_path):
    for index in range(36, 72):
        (loop.folder / 'drive' / f'{index:03d}.png').unlink()
    loop.write('name: loop\nquery: {path: drive}\ntruth: {kind: none}\nexclude_recent: 20')
    (one,) = run(loop, quick, tmp_path / 'out', 'convseq k=3 min_margin=0.05')
    assert (one['known'], one['accepted'], one['false_closures']) == (0, 0, 0)
    assert one['accuracy_matched'] is None
    assert one['auc_pr'] is None


def test_the_score_matrices_of_a_set_are_shown_single_frame_and_in_sequence(
    street, quick, tmp_path
):
    np.save(street.folder / 'net.npy', np.eye(24, dtype=np.float32))
    street.write(street.file.read_text() + 'published: {net: net.npy}')
    summaries = run(street, quick, tmp_path / 'out', 'published')
    assert [one['method'] for one in summaries] == ['net', 'net-k10', 'net-dynamic']
    assert [one['accuracy_matched'] for one in summaries] == [1, 1, 1]
    assert summaries[0]['matched'] == 24
    assert summaries[1]['matched'] == 15


@pytest.mark.parametrize(
    ('methods', 'problem'),
    [
        (('convseq', 'convseq'), 'convseq: two methods have this label'),
        (('netvlad',), "method 'netvlad' is not one of convseq"),
        (('hog file=file.npy',), "unknown option 'file'"),
        (('scores',), 'method scores: add file=FILE'),
        (('convseq max_lenth=3',), "unknown option 'max_lenth'; did you mean max_length?"),
        (('convseq fixed_length=many',), 'fixed_length: expected int'),
        (('convseq mode=online',), "unknown option 'mode'"),
        (('convseq keypoints=0',), 'keypoints changes nothing, for every image of street is a pl'),
        (('convseq image_mask=absent.png',), 'image_mask: absent.png: no such file'),
        (('orb-bow k=3',), 'method orb-bow-k3: orb-bow takes no k'),
        (('single k=dynamic',), 'method single-dynamic: single takes no k'),
        (('scores file=absent.npy',), r'absent.npy: No such file'),
        (('published',), 'street: has no published scores; name another method'),
        (('',), "method ''"),
        (('convseq k10',), "method 'convseq k10': expected a name and options"),
        (('seqslam k=20',), 'seqslam takes no k; give ds, its own'),
        (('cohog k=20',), 'cohog takes no k; paper does'),
        (('paper k=²',), 'k is a number or dynamic'),
        (('cohog label=..',), "label '..' is no folder name"),
    ],
)
def test_an_invalid_method_is_refused_in_one_line(street, quick, tmp_path, methods, problem):
    with pytest.raises(ConvseqError, match=problem) as caught:
        run(street, quick, tmp_path / 'out', *methods)
    assert '\n' not in str(caught.value)


def test_the_set_says_whether_the_map_grows_and_not_the_parameters_of_a_robot(
    street, quick, tmp_path
):
    robot = overridden(quick, {'mode': 'online'})
    (one,) = run(street, robot, tmp_path / 'out', 'convseq')
    assert one['accuracy_all'] >= 0.9 and one['configuration']['mode'] == 'preloaded'


def test_a_method_may_have_a_mask_of_its_own(street, quick, tmp_path):
    mask = tmp_path / 'mask.png'
    assert cv2.imwrite(
        str(mask), np.repeat(np.uint8([[255], [0]]), 64, axis=0) @ np.ones((1, 128))
    )
    masked, whole = run(
        street, quick, tmp_path / 'out', f'convseq image_mask={mask} label=m', 'convseq'
    )
    assert masked['configuration']['image_mask'].startswith('#')
    assert whole['configuration']['image_mask'] == ''


def test_images_that_cannot_be_read_are_told(street, quick, tmp_path):
    (street.folder / 'query' / '003.png').write_bytes(b'torn')
    warnings = []
    sets = [open_data_set(str(street.file))]
    evaluate(sets, quick, Plan(methods=('cohog',)), tmp_path / 'out', warn=warnings.append)
    (line,) = warnings
    assert 'query: 1 of 24 images cannot be read, such as' in line and '003.png' in line


def test_a_picture_that_is_missing_is_named(street, quick, tmp_path):
    (picture := street.folder / 'query' / '003.png').unlink()
    picture.symlink_to('absent.png')
    with pytest.raises(ConvseqError, match=r'query/003.png: No such file or dir.*; restore it'):
        run(street, quick, tmp_path / 'out', 'cohog')


@pytest.mark.filterwarnings('error')
def test_a_figure_without_answers_and_truth_has_no_legend(street, quick, tmp_path):
    for picture in (street.folder / 'query').iterdir():
        cv2.imwrite(str(picture), np.zeros((128, 128), np.uint8))
    street.write(street.file.read_text().replace('identity, tolerance: 1', 'none'))
    (summary,) = run(street, quick, tmp_path / 'out', 'hog')
    assert summary['matched'] == 0


def test_queries_with_every_place_right_are_told_once_and_on_the_page(street, quick, tmp_path):
    street.write(street.file.read_text().replace('tolerance: 1', 'tolerance: 13'))
    warnings = []
    sets = [open_data_set(str(street.file))]
    methods = ('cohog', 'hog')
    found = evaluate(sets, quick, Plan(methods), tmp_path / 'out', warn=warnings.append)
    assert [one['unmissable'] for one in found] == [4, 4]
    (line,) = warnings
    assert line.startswith('street: for 4 of 24 queries every place is right')
    page = (tmp_path / 'out' / 'report.html').read_text('utf-8')
    assert 'every place is right for 4 queries' in page


def test_references_of_one_time_keep_their_numbers(street, quick, tmp_path):
    for index in range(24):
        image = street.folder / 'reference' / f'{index:03d}.png'
        image.rename(image.with_name(f'{"lr"[index % 2]}_{1305031100 + index // 2}.0.png'))
    for one in run(street, quick, tmp_path / 'out', 'convseq', 'cohog'):
        assert one['accuracy_all'] >= 0.9


def test_a_map_without_keypoints_gives_nothing(street, quick, tmp_path):
    for image in (street.folder / 'reference').iterdir():
        assert cv2.imwrite(str(image), np.zeros((128, 128), np.uint8))
    for one in run(street, quick, tmp_path / 'out', 'orb-bow', 'sift-vlad'):
        assert one['matched'] == 0


def test_two_sets_of_one_name_are_refused(street, quick, tmp_path):
    with pytest.raises(ConfigError, match='street: two data sets have this name'):
        run(street, quick, tmp_path / 'out', 'hog', files=[street.file] * 2)


@pytest.fixture
def accuracy(street, quick, tmp_path):
    """Return what a method reaches on the drawn street."""

    def measured(method):
        data_set = open_data_set(str(street.file))
        plan = Plan(methods=(method,))
        (summary,) = evaluate([data_set], quick, plan, tmp_path / 'out')
        return summary['accuracy_all']

    return measured


def test_distances_can_be_given_instead_of_scores(accuracy, tmp_path):
    np.save(tmp_path / 'net.npy', 1 - np.eye(24))
    assert accuracy(f'scores file={tmp_path}/net.npy') < 0.2
    assert accuracy(f'scores file={tmp_path}/net.npy lower_is_better=true') == 1
    np.save(tmp_path / 'complex.npy', np.eye(24, dtype=complex))
    with pytest.raises(ConvseqError, match=r'complex.npy: not a .npy file of plain numbers'):
        accuracy(f'scores file={tmp_path}/complex.npy')
    with pytest.raises(ConvseqError, match="lower_is_better is true or false, not 'yes'"):
        accuracy(f'scores file={tmp_path}/net.npy lower_is_better=yes')


def test_descriptors_are_compared_by_cosine(accuracy, tmp_path):
    rows = np.random.default_rng(0).normal(size=(24, 8))
    np.save(tmp_path / 'q.npy', rows)
    np.save(tmp_path / 'r.npy', 3 * rows)
    np.save(tmp_path / 'short.npy', rows[:, :5])
    assert accuracy(f'descriptors query={tmp_path}/q.npy reference={tmp_path}/r.npy') == 1
    with pytest.raises(ConvseqError, match='descriptors of 8 and 5 numbers cannot be compared'):
        accuracy(f'descriptors query={tmp_path}/q.npy reference={tmp_path}/short.npy')
    with pytest.raises(ConvseqError, match='add query=FILE'):
        accuracy(f'descriptors reference={tmp_path}/q.npy')


def test_an_onnx_model_describes_the_images(accuracy, tmp_path):
    from descriptor_models import made

    net = made(tmp_path / 'm.onnx', 'random', 32, 64)
    assert accuracy(f'onnx file={net}') > 0.6
    with pytest.raises(ConvseqError, match=r'size \(16, 16\) contradicts the model'):
        accuracy(f'onnx file={net} size=16x16')
    with pytest.raises(ConvseqError, match='could not convert string to float'):
        accuracy(f'onnx file={net} mean=half')


def test_a_model_is_a_first_stage_of_the_recogniser(accuracy, tmp_path):
    from descriptor_models import made

    net = made(tmp_path / 'net.onnx', 'random', 32, 64)
    assert accuracy(f'convseq descriptor_model={net}') > 0.6
    made(net, 'hog', 32, 64)
    assert accuracy(f'convseq descriptor_model={net}') > 0.6  # not what was kept of the other one


def test_bag_of_words_decides_by_itself_and_refuses_invalid_options(accuracy):
    assert accuracy('orb-bow') is not None
    for option, problem in {
        'alpha=low': "is not a number: 'low'",
        'alpha=nan': "is not a number: 'nan'",
        'direct=-1': 'is -1; ',
        'rows=-1': 'is -1; ',
    }.items():
        with pytest.raises(ConvseqError, match=f'{option.split("=")[0]} {problem}'):
            accuracy(f'orb-bow {option}')


# The released script resizes by OpenCV's INTER_LINEAR.
PAPER = overridden(Config(), {'matching': 'regional', 'search': 'exhaustive', 'resize': 'linear'})


# Accuracies of the published matrices of ten techniques.
SINGLE = {
    'alexnet': 0.685, 'amosnet': 0.847, 'ap-gem': 0.532, 'calc': 0.324, 'cohog': 0.622,
    'densevlad': 0.703, 'hog': 0.477, 'hybridnet': 0.901, 'netvlad': 0.676, 'regionvlad': 0.432,
}  # fmt: skip


def test_accuracy_on_corridor_is_as_published(shared_data, tmp_path):
    data_set = open_data_set('corridor', shared_data)
    matrices = [f'scores file={path} label={name}' for name, path in data_set.published.items()]
    longer = f'scores file={data_set.published["vprbench-netvlad"]} k=10 label=longer'
    plan = Plan(methods=('cohog', 'seqslam', longer, *matrices))
    rows = evaluate([data_set], PAPER, plan, tmp_path)
    found = {one['method']: one['accuracy_matched'] for one in rows}
    assert 0.62 <= found['cohog'] <= 0.68
    # Without its wrap-around.
    assert found['seqslam'] == pytest.approx(0.5, abs=0.02)
    assert {name: found[f'vprbench-{name}'] for name in SINGLE} == pytest.approx(SINGLE, abs=1e-3)
    assert found['longer'] > SINGLE['netvlad']


@pytest.mark.parametrize(
    ('text', 'label', 'kind', 'length'),
    [
        ('convseq', 'convseq', 'convseq', None),
        ('convseq k=10', 'convseq-k10', 'convseq', 10),
        ('scores file="a b.npy" k=dynamic', 'scores-a_b.npy-dynamic', 'scores', 0),
        ('onnx file=m.onnx size=224x224 k=7 label=net', 'net', 'onnx', 7),
    ],
)
def test_a_text_names_a_method_and_its_options(text, label, kind, length):
    name = parse_method(text)
    assert (name.label, name.kind, name.length) == (label, kind, length)
    assert 'k' not in name.options and 'label' not in name.options


def test_the_length_of_a_method_wins_over_the_parameter(monkeypatch):
    monkeypatch.setattr(methods, 'load', lambda *_: None)
    config = overridden(Config(), {'fixed_length': 7})
    lengths = {
        kind: make_method(parse_method(kind), config).config.sequence.fixed_length
        for kind, row in KINDS.items()
        if not row.files
    }
    assert lengths == {
        'convseq': 7, 'single': 1, 'verified': 1, 'paper': 7, 'cohog': 1, 'seqslam': 10,
        'hog': 1, 'orb-bow': 1, 'sift-vlad': 1, 'hbst': 1,
    }  # fmt: skip


def test_the_published_method_matches_as_published():
    config = overridden(Config(), {'matching': 'coherent', 'search': 'shortlist'})
    method = make_method(parse_method('cohog'), config)
    assert method.config.matching.matching == 'regional'
    assert method.config.matching.search == 'exhaustive'


@pytest.mark.parametrize(
    ('text', 'length', 'believes'),
    [
        ('convseq', 0, True), ('convseq k=dynamic', 0, True),
        ('convseq rival_distance=20', 0, True),
        ('convseq k=1', 1, False), ('convseq k=10', 10, False),
        ('convseq k=10 acceptance_rule=belief', 10, True),
    ],
)  # fmt: skip
def test_only_methods_of_a_fixed_number_of_frames_decide_by_margin(text, length, believes):
    config = make_method(parse_method(text), Config()).config
    assert (config.sequence.fixed_length, config.believes) == (length, believes)


@pytest.mark.parametrize(('kind', 'package'), [('hog', 'scikit-image'), ('hbst', 'pyhbst')])
def test_a_missing_package_is_reported_before_any_image_is_read(
    street, tmp_path, monkeypatch, kind, package
):
    monkeypatch.setitem(sys.modules, KINDS[kind].needs, None)
    monkeypatch.setattr(bench, 'open_material', lambda *_: pytest.fail('it reads images'))
    with pytest.raises(ConfigError, match=f'method {kind}: needs {package}: pip install '):
        run(street, Config(), tmp_path / 'out', 'convseq', kind)
