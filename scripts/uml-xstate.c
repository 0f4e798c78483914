/* Lets User-Mode Linux run on processors whose registers outgrow it: preloaded into its kernel by vcan-run.
 *
 * UML of Linux 6.1 keeps 2696 bytes of extended state for each process. A host with AMX has 11008, and refuses to set fewer
 * than all (PTRACE_SETREGSET of NT_X86_XSTATE). So we fetch all, lay over it what UML kept, and set all: what lies beyond
 * is the tile registers, which no process in the guest is permitted to use.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

long ptrace(enum __ptrace_request request, ...)
{
  static long (*of_libc)(int, ...);
  static char all[65536];
  va_list arguments;
  va_start(arguments, request);
  pid_t process = va_arg(arguments, pid_t);
  void *address = va_arg(arguments, void *), *data = va_arg(arguments, void *);
  va_end(arguments);
  if (!of_libc)
    of_libc = dlsym(RTLD_NEXT, "ptrace");
  if (request != PTRACE_SETREGSET || (long)address != NT_X86_XSTATE)
    return of_libc(request, process, address, data);
  struct iovec *kept = data, whole = {all, sizeof all};
  if (of_libc(PTRACE_GETREGSET, process, address, &whole) < 0)
    return -1;
  if (kept->iov_len >= whole.iov_len)
    return of_libc(request, process, address, data);
  memcpy(all, kept->iov_base, kept->iov_len);
  return of_libc(request, process, address, &whole);
}
