// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// DBoW2's vocabulary of ORB for dbow2.py; descriptors are rows of 32 bytes.
#include "DBoW2/FORB.h"
#include "DBoW2/TemplatedVocabulary.h"
#include <cstdlib>
#include <cstring>
#include <vector>

using Vocabulary = DBoW2::TemplatedVocabulary<DBoW2::FORB::TDescriptor, DBoW2::FORB>;

static std::vector<cv::Mat> image_of(const unsigned char *descriptors, long count)
{
    std::vector<cv::Mat> rows;
    for (long row = 0; row < count; ++row) {
        rows.emplace_back(1, 32, CV_8U);
        std::memcpy(rows.back().data, descriptors + 32 * row, 32);
    }
    return rows;
}

extern "C" {

Vocabulary *learn(const unsigned char *descriptors, const long *counts, long images, int branches, int levels)
{
    std::srand(0);
    std::vector<std::vector<cv::Mat>> learnt_of;
    for (long image = 0; image < images; descriptors += 32 * counts[image++])
        learnt_of.push_back(image_of(descriptors, counts[image]));
    auto *made = new Vocabulary(branches, levels, DBoW2::TF_IDF, DBoW2::L1_NORM);
    made->create(learnt_of);
    return made;
}

long size(const Vocabulary *vocabulary)
{
    return vocabulary->size();
}

void bag(const Vocabulary *vocabulary, const unsigned char *descriptors, long count, float *weights)
{
    DBoW2::BowVector words;
    vocabulary->transform(image_of(descriptors, count), words);
    for (const auto &word : words)
        weights[word.first] = static_cast<float>(word.second);
}

}
