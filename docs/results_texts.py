# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What docs/RESULTS.md says between its tables."""

ONE_LINE = {
    'coherent': 'ours, as shipped: where the salient regions went, dynamic k, backward window, '
    'shortlist',
    'background-kept': 'coherent with `subtract_background: false`: cells and regions as they '
    'are, no global similarity',
    '-exhaustive': 'every reference is scored',
    '-k10, -k1': 'fixed k',
    'regional': "the paper's pair score, dynamic k, backward window, every reference",
    'regional-k10': 'the same with fixed k',
    'convseq-forward': 'ConvSequential-SLAM as published: dynamic k, window into the future',
    'cohog': 'CoHOG: the same pair score on single frames',
    'seqslam': 'SeqSLAM, ds = 10, lines that end at the newest frame, signed arithmetic',
    'hog': 'HOG of the whole image, cosine',
    'vprbench-*': 'score matrices that VPR-Bench published; -k10 and -dynamic add our sequences',
}
READING = """\
**How to read it.** *Right, of matched*: right answers among the queries that were matched (the
first frames wait for their sequence, or the last in a forward window) and have an answer; the
interval is a block bootstrap over contiguous blocks of the sequence. *Right, of all*: among all
queries that have an answer. *AUC-PR*: exact, recall over the right matches, as scikit-learn and
VPR-Bench count it. *R at 100 % P*: share of the matched queries that score above every wrong one.
*t_e*: time to encode an image; *frame*: to encode it, score it (against all references or those on
the shortlist) and decide.
*PCU* = P_R100 x log10(t_e_max / t_e + 9). A right answer lies within the tolerance of the set; a
*slip* is off by up to three frames more, everything else that is wrong is *false*.
"""
DECISIONS = """\
## Closures: what is accepted, at the shipped defaults

With half of the map removed (the first, the last and the middle half kept in turn), and with
drives against their own past, the latest frames left out; drives that are called forwards and
backwards revisit nothing. *Known*: queries that have a right reference; *in reach*: those whose
whole sequence of k frames lies in the map, over which *recall* is taken (the first frames after
the map is entered can be recognised sooner, by half of the sequence: *of all known*). *Slip*: the
right place, 3 to 5 frames off. *False*: another place.
The constants of the belief were chosen on corridor, laps and Gardens Point;
`scripts/fit_observation.py` prints a fit beside them.
"""
AGREEMENT = """\
## Does a shortlist decide as whole rows do?

Share of all frames of a set (half of the map removed, or against its own past) with the same
decision as with every reference scored: no match, or one within two references.
"""
RELIABILITY = """\
## How much is a confidence worth?

All frames of the sets above that got a confidence, at the shipped defaults (by the margin rule
there is none). *Right*: the best candidate shows the right place, slips included. *As shipped*:
the share of the belief that the place and its looks hold. *From other places*: after a logistic
fit on the other places only, for each set anew.
"""
UNKNOWN = """\
## What the paper reports

Its tables are pictures and its curves are drawn; their numbers are not known here and none is
restated. Known are: 90 % for CoHOG on Gardens Point day-day within two frames (its authors' list
of retrieved images), VPR-Bench's score matrices for corridor, and the output of the released
script on corridor.
"""
