/* Modem lines for pseudo terminals, which have none: preloaded, ioctl answers for them as a UART with
 * nothing attached. ser2net needs them for RFC 2217. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdarg.h>
#include <sys/ioctl.h>

static int lines;

int ioctl(int fd, unsigned long request, ...)
{
    static int (*next)(int, unsigned long, ...);
    va_list rest;
    void *argument;
    int found, saved = errno;

    va_start(rest, request);
    argument = va_arg(rest, void *);
    va_end(rest);
    if (!next)
        next = (int (*)(int, unsigned long, ...))dlsym(RTLD_NEXT, "ioctl");
    found = next(fd, request, argument);
    if (found == 0 || (errno != ENOTTY && errno != EINVAL))
        return found;
    switch (request) {
    case TIOCMGET: *(int *)argument = lines; break;
    case TIOCMSET: lines = *(int *)argument; break;
    case TIOCMBIS: lines |= *(int *)argument; break;
    case TIOCMBIC: lines &= ~*(int *)argument; break;
    default: return found;
    }
    errno = saved;
    return 0;
}
