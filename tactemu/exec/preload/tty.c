/* What a pseudo terminal lacks compared with a USB serial port: modem lines, break, parity, byte size, serial_struct.
 *
 * Each port has a page of memory and a pipe in the view, found by the number of its pseudo terminal. The page has the
 * state for all processes that have the port open; the pipe carries the changes, in order. Reads and writes are the
 * kernel's own, and so are the errors of an unplugged port: the kernel hangs the pseudo terminal up.
 */
#include "preload.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

/* Layout as in tactemu/exec/shared_page.py. */
struct page {
    uint32_t lines;   /* TIOCM_*: those of the driver and those of the device */
    uint32_t control; /* c_cflag as the driver set it; 0: never set */
    uint32_t broken;  /* the line is held in the break condition */
    int32_t flags;    /* of struct serial_struct, ASYNC_LOW_LATENCY among them */
    uint32_t number;  /* number of the port: 0 for ttyUSB0 */
    uint16_t close_delay, closing_wait; /* [1/100 s] */
};
enum { LINES = 1, CONTROL, BREAK, FLAGS }; /* the field of a change, which is sent with its new value */

/* struct termios2 (44 bytes) is in a header that conflicts with libc's. */
#undef TCGETS2
#undef TCSETS2
#undef TCSETSW2
#undef TCSETSF2
#define TCGETS2 _IOR('T', 0x2A, char[44])
#define TCSETS2 _IOW('T', 0x2B, char[44])
#define TCSETSW2 _IOW('T', 0x2C, char[44])
#define TCSETSF2 _IOW('T', 0x2D, char[44])

#define OURS (TIOCM_DTR | TIOCM_RTS) /* the lines that a driver sets */
#define KEPT (CSIZE | PARENB)        /* the control flags that a pseudo terminal does not keep */
#define FIRST_PTS 136u               /* majors of pseudo terminals */
#define LAST_PTS 143u
#define POLL_MS 5 /* interval of checks of the lines while a driver waits for a change */

static bool name_of(int fd, const char *what, char *path, size_t size) {
    struct stat status;
    if (fstat(fd, &status) || !S_ISCHR(status.st_mode)) return false;
    unsigned type = major(status.st_rdev);
    if (type < FIRST_PTS || type > LAST_PTS) return false;
    return snprintf(path, size, ROOM "/ports/%u:%u.%s", type, minor(status.st_rdev), what) < (int)size;
}

/* Return the page of an emulated port, or NULL for any other descriptor. errno stays as it was. */
static struct page *page_of(int fd) {
    char path[64];
    int before = errno;
    struct page *page = NULL;
    int file = name_of(fd, "page", path, sizeof path) ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (file >= 0) {
        void *seen = mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        page = seen == MAP_FAILED ? NULL : seen;
        close(file);
    }
    errno = before;
    return page;
}

static void unmap_page(struct page *page) {
    munmap(page, sizeof *page);
}

/* Send a change to the emulator. If it does not read for a second, the change is lost; the page still has the state. */
static void send_change(int fd, uint32_t what, uint32_t value) {
    char path[64];
    int before = errno;
    int pipe = name_of(fd, "told", path, sizeof path) ? open(path, O_WRONLY | O_NONBLOCK | O_CLOEXEC) : -1;
    if (pipe >= 0) {
        uint32_t message[2] = {what, value};
        struct pollfd room = {.fd = pipe, .events = POLLOUT};
        if (write(pipe, message, sizeof message) < 0 && errno == EAGAIN && poll(&room, 1, 1000) == 1) {
            if (write(pipe, message, sizeof message) < 0) errno = before;
        }
        close(pipe);
    }
    errno = before;
}

static void set_lines(int fd, struct page *page, uint32_t clear, uint32_t set) {
    uint32_t lines = __atomic_load_n(&page->lines, __ATOMIC_SEQ_CST), next;
    do {
        next = (lines & ~(clear & OURS)) | (set & OURS);
    } while (!__atomic_compare_exchange_n(&page->lines, &lines, next, false, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST));
    if (next != lines) send_change(fd, LINES, next);
}

static void set_control(int fd, struct page *page, uint32_t control) {
    uint32_t before = __atomic_exchange_n(&page->control, control, __ATOMIC_SEQ_CST);
    if (before != control) send_change(fd, CONTROL, control);
    bool hung_up = before && !(before & CBAUD);
    if (!(control & CBAUD)) {
        set_lines(fd, page, OURS, 0);
    } else if (hung_up) {
        set_lines(fd, page, 0, OURS);
    }
}

static void set_break(int fd, struct page *page, uint32_t on) {
    if (__atomic_exchange_n(&page->broken, on, __ATOMIC_SEQ_CST) != on) send_change(fd, BREAK, on);
}

/* Hold the line in the break condition; a signal ends it, as in the kernel. */
static int hold_break(int fd, struct page *page, int milliseconds) {
    set_break(fd, page, 1);
    struct pollfd gone = {.fd = fd, .events = 0};
    int result = poll(&gone, 1, milliseconds) < 0 ? -1 : 0;
    set_break(fd, page, 0);
    return result;
}

/* Wait until one of the lines of the mask changes; EIO if the port is unplugged. */
static int wait_for_lines(int fd, const struct page *page, uint32_t mask) {
    uint32_t before = __atomic_load_n(&page->lines, __ATOMIC_SEQ_CST);
    struct pollfd gone = {.fd = fd, .events = 0};
    while (!((before ^ __atomic_load_n(&page->lines, __ATOMIC_SEQ_CST)) & mask)) {
        int ready = poll(&gone, 1, POLL_MS);
        if (ready > 0) errno = EIO;
        if (ready) return -1;
    }
    return 0;
}

/* Answer a request that the kernel refuses for a pseudo terminal. */
static int answer(int fd, struct page *page, unsigned long request, void *argument) {
    switch (request) {
    case TIOCMGET:
        *(int *)argument = (int)__atomic_load_n(&page->lines, __ATOMIC_SEQ_CST);
        return 0;
    case TIOCMSET:
        set_lines(fd, page, OURS, *(uint32_t *)argument);
        return 0;
    case TIOCMBIS:
        set_lines(fd, page, 0, *(uint32_t *)argument);
        return 0;
    case TIOCMBIC:
        set_lines(fd, page, *(uint32_t *)argument, 0);
        return 0;
    case TIOCMIWAIT:
        return wait_for_lines(fd, page, (uint32_t)(uintptr_t)argument);
    case TIOCGICOUNT:
        memset(argument, 0, sizeof(struct serial_icounter_struct));
        return 0;
    case TIOCGSERIAL: {
        struct serial_struct *serial = argument;
        memset(serial, 0, sizeof *serial);
        serial->line = (int)page->number;
        serial->flags = page->flags;
        serial->close_delay = page->close_delay;
        serial->closing_wait = page->closing_wait;
        return 0;
    }
    case TIOCSSERIAL: {
        const struct serial_struct *serial = argument;
        page->close_delay = serial->close_delay;
        page->closing_wait = serial->closing_wait;
        int32_t before = __atomic_exchange_n(&page->flags, serial->flags, __ATOMIC_SEQ_CST);
        if (before != serial->flags) send_change(fd, FLAGS, (uint32_t)serial->flags);
        return 0;
    }
    default:
        errno = ENOTTY;
        return -1;
    }
}

/* Return the control flags, the third field of both the kernel's struct termios and termios2. */
static uint32_t *control_in(void *argument) {
    return (uint32_t *)argument + 2;
}

int tty_ioctl(int fd, unsigned long request, void *argument) {
    int result = REAL(ioctl)(fd, request, argument);
    struct page *page = NULL;
    switch (request) {
    case TIOCMGET: case TIOCMSET: case TIOCMBIS: case TIOCMBIC: case TIOCMIWAIT: case TIOCGICOUNT: case TIOCGSERIAL:
    case TIOCSSERIAL:
        if (result == 0 || (errno != ENOTTY && errno != EINVAL) || !(page = page_of(fd))) return result;
        result = answer(fd, page, request, argument);
        break;
    case TCSETS: case TCSETSW: case TCSETSF: case TCSETS2: case TCSETSW2: case TCSETSF2:
        if (result || !(page = page_of(fd))) return result;
        set_control(fd, page, *control_in(argument));
        break;
    case TCGETS: case TCGETS2:
        if (result || !(page = page_of(fd))) return result;
        if (page->control) *control_in(argument) = (*control_in(argument) & ~KEPT) | (page->control & KEPT);
        break;
    case TIOCSBRK: case TIOCCBRK:
        if (result || !(page = page_of(fd))) return result;
        set_break(fd, page, request == TIOCSBRK);
        break;
    case TCSBRK: case TCSBRKP:
        if (result || (request == TCSBRK && argument) || !(page = page_of(fd))) return result;
        result = hold_break(fd, page, argument ? (int)(intptr_t)argument * 100 : 250);
        break;
    default:
        return result;
    }
    unmap_page(page);
    return result;
}

/* Replace libc's function, which does not call ioctl, and refuses flags that a pseudo terminal does not keep. */
int tty_setattr(int fd, int actions, const struct termios *settings) {
    struct page *page = page_of(fd);
    if (!page) return REAL(tcsetattr)(fd, actions, settings);
    struct termios plain = *settings;
    plain.c_cflag = (plain.c_cflag & ~(tcflag_t)KEPT) | CS8 | CREAD;
    int result = REAL(tcsetattr)(fd, actions, &plain);
    if (!result) set_control(fd, page, settings->c_cflag);
    unmap_page(page);
    return result;
}

int tty_getattr(int fd, struct termios *settings) {
    int result = REAL(tcgetattr)(fd, settings);
    struct page *page = result ? NULL : page_of(fd);
    if (!page) return result;
    if (page->control) settings->c_cflag = (settings->c_cflag & ~(tcflag_t)KEPT) | (page->control & KEPT);
    unmap_page(page);
    return result;
}

int tty_sendbreak(int fd, int duration) {
    int result = REAL(tcsendbreak)(fd, duration);
    struct page *page = result ? NULL : page_of(fd);
    if (!page) return result;
    result = hold_break(fd, page, duration > 0 ? duration * 100 : 250);
    unmap_page(page);
    return result;
}
