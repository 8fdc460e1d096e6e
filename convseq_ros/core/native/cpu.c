// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What this processor, and its operating system, let a program use: for each file named after a
// kind of processors, whether its kernels can run.
#define TELL(name) __attribute__((visibility("default"))) int convseq_##name(void)

// Raised whenever a kernel's arguments or a layout change; compiled.py has the same number.
TELL(version) { return 6; }

#ifdef __x86_64__
// The compiler's run time asks the processor what it has, and the system what it keeps.
#define HAS(name) __builtin_cpu_supports(name)
TELL(has_avx2) { return HAS("avx2") && HAS("fma") && HAS("f16c"); }
TELL(has_avxvnni) { return convseq_has_avx2() && HAS("avxvnni"); }
TELL(has_avx512)
{
    return convseq_has_avx2() && HAS("avx512f") && HAS("avx512bw") && HAS("avx512dq") &&
           HAS("avx512vl") && HAS("avx512vnni") && HAS("avx512vbmi2");
}
#elif defined(__aarch64__)
#include <sys/auxv.h>
TELL(has_neon) { return 1; }
TELL(has_dotprod) { return getauxval(AT_HWCAP) >> 20 & 1; } // HWCAP_ASIMDDP
#endif
