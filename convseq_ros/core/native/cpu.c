// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// What this processor, and its operating system, let a program use.
#define EXPORT __attribute__((visibility("default")))

// Raised whenever a kernel's arguments or a layout change; `compiled.py` has the same number.
EXPORT int convseq_version(void)
{
    return 2;
}

#ifdef __x86_64__
// The compiler's run time asks the processor which registers it has, and the system which it saves.
EXPORT int convseq_has_avx512(void)
{
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512vnni") && __builtin_cpu_supports("avx512vbmi2") &&
           __builtin_cpu_supports("f16c") && __builtin_cpu_supports("fma");
}

EXPORT int convseq_has_avx2(void)
{
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
           __builtin_cpu_supports("f16c");
}

EXPORT int convseq_has_avxvnni(void)
{
    return convseq_has_avx2() && __builtin_cpu_supports("avxvnni");
}

EXPORT int convseq_has_sse4(void)
{
    return __builtin_cpu_supports("sse4.1");
}
#elif defined(__aarch64__)
#include <sys/auxv.h>

EXPORT int convseq_has_dotprod(void)
{
    return getauxval(AT_HWCAP) >> 20 & 1; // HWCAP_ASIMDDP, which old headers lack
}

EXPORT int convseq_has_neon(void)
{
    return 1;
}
#endif
