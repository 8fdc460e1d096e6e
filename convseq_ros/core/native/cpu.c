// Copyright 2026 The convseq_ros authors
// SPDX-License-Identifier: Apache-2.0
// The instructions that the processor and its operating system support: for each kind of processor
// (avx2.c and so on), whether its kernels can run; and a probe that verifies it.
#include <setjmp.h>
#include <signal.h>
#include <stddef.h>

#define TELL(name) __attribute__((visibility("default"))) int convseq_##name(void)

// Raised whenever a kernel's arguments or a layout change; compiled.py has the same number.
TELL(version) { return 24; }

#ifdef __x86_64__
// The compiler's run time checks the processor, and which registers the system saves.
#define HAS(name) __builtin_cpu_supports(name)
TELL(has_avx2) { return HAS("x86-64-v3"); }
TELL(has_avxvnni) { return convseq_has_avx2() && HAS("avxvnni"); }
TELL(has_avx512) { return HAS("x86-64-v4") && HAS("avx512vnni") && HAS("avx512vbmi2"); }
#elif defined(__aarch64__)
#include <sys/auxv.h>
TELL(has_neon) { return 1; }
TELL(has_dotprod) { return getauxval(AT_HWCAP) >> 20 & 1; } // HWCAP_ASIMDDP
#endif

static sigjmp_buf before;

static void went_wrong(int number) { siglongjmp(before, number); }

// Return the result of a probe, or 1 if it meets an unsupported instruction. For one thread at a
// time.
__attribute__((visibility("default"))) int convseq_tried(int (*probe)(void))
{
    struct sigaction ours = {.sa_handler = went_wrong, .sa_flags = SA_NODEFER}, theirs;
    int failed = 1;
    if (sigaction(SIGILL, &ours, &theirs))
        return 1;
    if (!sigsetjmp(before, 1))
        failed = probe();
    sigaction(SIGILL, &theirs, NULL);
    return failed;
}
