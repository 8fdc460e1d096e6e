# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page of what `convseq evaluate` measured."""
