/*
 * What DDS implementations do with a signed document, by OpenSSL itself and by the very calls that they make.
 *
 * pinned: PKCS7_verify with the certificates of the permissions CA file as the only ones and PKCS7_TEXT |
 *         PKCS7_NOVERIFY | PKCS7_NOINTERN, as Fast DDS (2.1.4, from 2.6.5), Cyclone DDS 11 and OpenDDS do.
 * chain:  PKCS7_verify with these certificates as a store of trusted ones and PKCS7_TEXT, as Fast DDS 2.3.6, 2.6.4,
 *         2.7.1, 2.9.1 and Cyclone DDS up to 0.10.5 do. Those look at the clock; here the instant is fixed, since
 *         dates are no business of the signature.
 *
 * One long-lived process. A request is a length (4 bytes, big endian) and as many bytes: `T` and the PEM file of what
 * is trusted, answered by nothing, or `M` and a message, answered by four verdicts: pinned and chain with the message
 * in memory (as Cyclone DDS hands it over), pinned and chain with the message in a file (as Fast DDS does). A verdict
 * is one byte, 1 for accepted or 0, a length (4 bytes, big endian) and as many bytes of content.
 */
#define _POSIX_C_SOURCE 200809L
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509_vfy.h>
#include <stdio.h>
#include <stdlib.h>

static const time_t INSTANT = 1893456000; /* 2030-01-01T00:00:00Z */
static const size_t LARGEST_REQUEST = 64 << 20;

static STACK_OF(X509) *authorities;
static X509_STORE *store;

static void trust(const unsigned char *pem, int length)
{
    BIO *file = BIO_new_mem_buf(pem, length);
    X509 *certificate;

    sk_X509_pop_free(authorities, X509_free);
    X509_STORE_free(store);
    authorities = sk_X509_new_null();
    store = X509_STORE_new();
    X509_VERIFY_PARAM_set_time(X509_STORE_get0_param(store), INSTANT);
    while ((certificate = PEM_read_bio_X509(file, NULL, NULL, NULL)) != NULL) {
        sk_X509_push(authorities, certificate);
        X509_STORE_add_cert(store, certificate);
    }
    BIO_free(file);
    ERR_clear_error();
}

static void write_length(size_t length)
{
    for (int shift = 24; shift >= 0; shift -= 8)
        putchar((int)(length >> shift & 0xff));
}

/* Answer with the verdict on the message that `source` reads, and free it. */
static void verify(BIO *source, int pinned)
{
    BIO *content = NULL, *accepted = BIO_new(BIO_s_mem());
    PKCS7 *signed_data = source == NULL ? NULL : SMIME_read_PKCS7(source, &content);
    int verdict = 0;
    char *text = NULL;
    long length = 0;

    if (signed_data != NULL && pinned)
        verdict = PKCS7_verify(signed_data, authorities, NULL, content, accepted,
                               PKCS7_TEXT | PKCS7_NOVERIFY | PKCS7_NOINTERN) == 1;
    else if (signed_data != NULL)
        verdict = PKCS7_verify(signed_data, NULL, store, content, accepted, PKCS7_TEXT) == 1;
    if (verdict)
        length = BIO_get_mem_data(accepted, &text);
    putchar(verdict);
    write_length((size_t)length);
    fwrite(text, 1, (size_t)length, stdout);
    ERR_clear_error();
    PKCS7_free(signed_data);
    BIO_free(content);
    BIO_free(accepted);
    BIO_free(source);
}

static BIO *in_file(unsigned char *message, size_t length)
{
    FILE *file = length == 0 ? fopen("/dev/null", "r") : fmemopen(message, length, "r");

    return file == NULL ? NULL : BIO_new_fp(file, BIO_CLOSE);
}

int main(void)
{
    unsigned char head[4];

    trust((const unsigned char *)"", 0);
    while (fread(head, 1, sizeof(head), stdin) == sizeof(head)) {
        size_t length = (size_t)head[0] << 24 | (size_t)head[1] << 16 | (size_t)head[2] << 8 | head[3];
        unsigned char *request = length == 0 || length > LARGEST_REQUEST ? NULL : malloc(length);

        if (request == NULL || fread(request, 1, length, stdin) != length)
            return 2;
        if (request[0] == 'T') {
            trust(request + 1, (int)length - 1);
        } else {
            for (int pinned = 1; pinned >= 0; pinned--)
                verify(BIO_new_mem_buf(request + 1, (int)length - 1), pinned);
            for (int pinned = 1; pinned >= 0; pinned--)
                verify(in_file(request + 1, length - 1), pinned);
            fflush(stdout);
        }
        free(request);
    }
    return 0;
}
