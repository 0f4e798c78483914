/* What the files of the library share. Each subject has a file: tty.c, udev.c, can.c. main.c has every function of libc
 * that is replaced, and calls the subjects in turn.
 *
 * The library keeps nothing per descriptor: it asks the kernel each time which kind of descriptor one is. So dup, fork,
 * exec, threads and descriptors passed through sockets need no care, and there is nothing to lock. Only system calls are
 * made.
 */
#ifndef TACTEMU_PRELOAD_H
#define TACTEMU_PRELOAD_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <time.h>
#include <termios.h>

#define ROOM "/run/udev/.tactemu" /* the folder of the view that the emulator and this library share */

/* The function of libc behind the replaced one; looked up once, and two racing threads find the same one. */
#define REAL(name)                                                    \
    ({                                                                \
        static __typeof__(&name) found;                               \
        __typeof__(&name) real = __atomic_load_n(&found, __ATOMIC_RELAXED); \
        if (!real) {                                                  \
            real = (__typeof__(&name))dlsym(RTLD_NEXT, #name);        \
            __atomic_store_n(&found, real, __ATOMIC_RELAXED);         \
        }                                                             \
        real;                                                         \
    })

/* Hidden, because a driver may have functions of the same names. */
#pragma GCC visibility push(hidden)

/* tty.c: a pseudo terminal of the emulator answers like a USB serial port. */
int tty_ioctl(int fd, unsigned long request, void *argument);
int tty_setattr(int fd, int actions, const struct termios *settings);
int tty_getattr(int fd, struct termios *settings);
int tty_sendbreak(int fd, int duration);

/* udev.c: a socket for the kernel's and udev's events receives those of the view. */
int udev_socket(int type);
bool udev_is(int fd);
int udev_bind(int fd, const struct sockaddr *address, socklen_t length);
int udev_getsockname(int fd, struct sockaddr *address, socklen_t *length);
int udev_setsockopt(int fd, int level, int option, const void *value, socklen_t length);
ssize_t udev_recvmsg(int fd, struct msghdr *message, int flags);

/* can.c: CAN_RAW on an Ethernet interface. The state of a descriptor is 0 if it is no such socket. */
int can_state(int fd);
int can_socket(int type, int protocol);
int can_bind(int fd, const struct sockaddr *address, socklen_t length);
int can_getsockname(int fd, struct sockaddr *address, socklen_t *length);
int can_setsockopt(int fd, int level, int option, const void *value, socklen_t length);
int can_getsockopt(int fd, int level, int option, void *value, socklen_t *length);
int can_ioctl(int fd, unsigned long request, void *argument);
ssize_t can_send(int fd, int state, const void *data, size_t size, int flags);
ssize_t can_sendmsg(int fd, int state, const struct msghdr *message, int flags);
int can_sendmmsg(int fd, int state, struct mmsghdr *messages, unsigned count, int flags);
ssize_t can_recvmsg(int fd, struct msghdr *message, int flags);
int can_recvmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags, struct timespec *timeout);
ssize_t can_recvfrom(int fd, void *data, size_t size, int flags, struct sockaddr *address, socklen_t *length);
ssize_t can_failed(int fd);

#pragma GCC visibility pop

#endif
