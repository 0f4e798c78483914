/* What a vendor's program does to a serial port whose name it has by heart: modem lines, low latency, break, parity, a
 * speed of its own, and then it reads. Prints a line for each. */
#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

static int fd;

static int lines(void) {
    int word = -1;
    return ioctl(fd, TIOCMGET, &word) ? -errno : word;
}

static void *wait_for_unplug(void *result) {
    *(int *)result = ioctl(fd, TIOCMIWAIT, TIOCM_CTS | TIOCM_RNG) ? errno : 0;
    return NULL;
}

int main(int count, char **words) {
    (void)words;
    fd = open("/dev/ttyUSB0", O_RDWR | O_NOCTTY);
    if (fd < 0) return perror("/dev/ttyUSB0"), 1;
    printf("opened %x\n", lines());
    int dtr = TIOCM_DTR, rts = TIOCM_RTS, both = TIOCM_DTR | TIOCM_RTS;
    ioctl(fd, TIOCMBIC, &dtr);
    printf("dtr down %x\n", lines());
    ioctl(fd, TIOCMSET, &rts);
    ioctl(fd, TIOCMBIS, &both);
    printf("both up %x\n", lines());
    if (!fork()) { /* a child has the same port */
        ioctl(dup(fd), TIOCMBIC, &rts);
        _exit(0);
    }
    wait(NULL);
    printf("rts down by a child %x\n", lines());

    struct serial_struct serial;
    printf("serial %d", ioctl(fd, TIOCGSERIAL, &serial));
    serial.flags |= ASYNC_LOW_LATENCY;
    printf(" %d", ioctl(fd, TIOCSSERIAL, &serial));
    memset(&serial, 0, sizeof serial);
    ioctl(fd, TIOCGSERIAL, &serial);
    printf(" low latency %d\n", !!(serial.flags & ASYNC_LOW_LATENCY));

    struct termios settings;
    tcgetattr(fd, &settings);
    cfmakeraw(&settings);
    cfsetspeed(&settings, B921600);
    settings.c_cflag = (settings.c_cflag & ~CSIZE) | CS7 | PARENB | CLOCAL | CRTSCTS;
    int set = tcsetattr(fd, TCSANOW, &settings);
    tcgetattr(fd, &settings);
    printf("7E %d %d %d %d\n", set, (settings.c_cflag & CSIZE) == CS7, !!(settings.c_cflag & PARENB),
           !!(settings.c_cflag & CRTSCTS));
    printf("break %d\n", tcsendbreak(fd, 0));
    settings.c_cflag = (settings.c_cflag & ~(CSIZE | PARENB | CRTSCTS)) | CS8;
    printf("8N %d\n", tcsetattr(fd, TCSAFLUSH, &settings));
    fflush(stdout);
    if (count < 2) return 0;

    int waited = -1;
    pthread_t waiter;
    pthread_create(&waiter, NULL, wait_for_unplug, &waited);
    char data[4096];
    ssize_t size, all = 0;
    while ((size = read(fd, data, sizeof data)) > 0) {
        if (!all) puts("reads"), fflush(stdout);
        all += size;
    }
    printf("read %zd %d\n", size, size ? errno : 0);
    pthread_join(waiter, NULL);
    printf("waited %d\n", waited);
    printf("write %zd %d\n", write(fd, "x", 1), errno);
    printf("lines %d\n", lines());
    struct pollfd end = {.fd = fd, .events = POLLIN};
    poll(&end, 1, 0);
    printf("poll %x\n", end.revents);
    return 0;
}
