// Runs a command, and makes one of its system calls fail: whoever makes it, a library or the program itself, on any thread.
//
//     cc -O1 -o inject tools/inject.c
//     inject CALL NTH ERRNO once|always LOG COMMAND ARGUMENT…
//
// CALL is the name of a system call below, of which the NTH (from 1) fails with ERRNO, and with "always" all after it, too. NTH 0 lets all pass. LOG gets one number:
// how often the command made the call. Of `write`, those to standard output and standard error are left alone and not counted; of `mmap`, those that map no file.
//
// A seccomp filter stops the command at that call alone, so that the rest runs at full speed. Linux on x86-64. The exit code is the command's, or 128 and the signal.
#define _GNU_SOURCE
#include <errno.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

static const struct { const char *name; long number; } CALLS[] = {
    {"read", SYS_read}, {"pread64", SYS_pread64}, {"write", SYS_write}, {"pwrite64", SYS_pwrite64}, {"writev", SYS_writev},
    {"openat", SYS_openat}, {"close", SYS_close}, {"lseek", SYS_lseek}, {"mmap", SYS_mmap}, {"munmap", SYS_munmap},
    {"madvise", SYS_madvise}, {"fsync", SYS_fsync}, {"fdatasync", SYS_fdatasync}, {"ftruncate", SYS_ftruncate},
    {"fallocate", SYS_fallocate}, {"rename", SYS_rename}, {"renameat2", SYS_renameat2}, {"linkat", SYS_linkat},
    {"unlink", SYS_unlink}, {"unlinkat", SYS_unlinkat}, {"mkdir", SYS_mkdir}, {"rmdir", SYS_rmdir}, {"statx", SYS_statx},
    {"fstat", SYS_fstat}, {"newfstatat", SYS_newfstatat}, {"fstatfs", SYS_fstatfs}, {"statfs", SYS_statfs},
    {"getdents64", SYS_getdents64}, {"fcntl", SYS_fcntl}, {"flock", SYS_flock}, {"fchmod", SYS_fchmod}, {"fadvise64", SYS_fadvise64},
    {"clone3", SYS_clone3}, {"poll", SYS_poll}, {"readlink", SYS_readlink}, {"copy_file_range", SYS_copy_file_range},
};

static void fail(const char *what) { perror(what); exit(125); }

int main(int count, char **words) {
    if (count < 7) { fprintf(stderr, "inject CALL NTH ERRNO once|always LOG COMMAND ARGUMENT...\n"); return 125; }
    long number = -1, nth = atol(words[2]), code = atol(words[3]), seen = 0;
    int always = !strcmp(words[4], "always");
    for (size_t i = 0; i < sizeof CALLS / sizeof *CALLS; i++) if (!strcmp(CALLS[i].name, words[1])) number = CALLS[i].number;
    if (number < 0) { fprintf(stderr, "inject: no call %s\n", words[1]); return 125; }
    pid_t child = fork();
    if (child < 0) fail("fork");
    if (!child) {
        struct sock_filter filter[] = {
            BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch)),
            BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, AUDIT_ARCH_X86_64, 0, 2),
            BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
            BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (unsigned)number, 1, 0),
            BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
            BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRACE),
        };
        struct sock_fprog program = {sizeof filter / sizeof *filter, filter};
        if (ptrace(PTRACE_TRACEME, 0, 0, 0)) fail("ptrace");
        raise(SIGSTOP);
        if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program)) fail("seccomp");
        execvp(words[6], words + 6);
        fail(words[6]);
    }
    int status, result = 125;
    if (waitpid(child, &status, 0) != child || !WIFSTOPPED(status)) fail("the command");
    long options = PTRACE_O_TRACESECCOMP | PTRACE_O_TRACECLONE | PTRACE_O_TRACEFORK | PTRACE_O_TRACEVFORK | PTRACE_O_EXITKILL;
    if (ptrace(PTRACE_SETOPTIONS, child, 0, options) || ptrace(PTRACE_CONT, child, 0, 0)) fail("ptrace");
    for (pid_t who; (who = waitpid(-1, &status, __WALL)) > 0;) {
        if (WIFEXITED(status) || WIFSIGNALED(status)) {
            if (who == child) result = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
            continue;
        }
        int event = status >> 16, signal = WSTOPSIG(status), pass = 0;
        if (event == PTRACE_EVENT_SECCOMP) {
            struct user_regs_struct regs;
            if (ptrace(PTRACE_GETREGS, who, 0, &regs)) continue;
            int counts = 1;
            if (number == SYS_write) counts = (long)regs.rdi > 2;
            if (number == SYS_mmap) counts = (int)regs.r8 >= 0;
            if (counts) {
                seen++;
                if (nth && (always ? seen >= nth : seen == nth)) {
                    regs.orig_rax = -1;
                    regs.rax = -code;
                    ptrace(PTRACE_SETREGS, who, 0, &regs);
                }
            }
        } else if (!event && signal != SIGSTOP && signal != SIGTRAP) {
            pass = signal;
        }
        ptrace(PTRACE_CONT, who, 0, pass);
    }
    FILE *log = fopen(words[5], "w");
    if (log) { fprintf(log, "%ld\n", seen); fclose(log); }
    return result;
}
