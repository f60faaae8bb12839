/*
 * What a DDS implementation does with a signed document, by OpenSSL itself: SMIME_read_PKCS7, then PKCS7_verify with
 * the certificates of the permissions CA file alone and PKCS7_TEXT | PKCS7_NOVERIFY | PKCS7_NOINTERN, as Fast DDS
 * (from 2.6.5 and 2.14), Cyclone DDS 11 and OpenDDS call it.
 *
 * Usage: smime_oracle CA.pem
 * Reads paths from standard input, one a line, and answers each with one line:
 *     ok SHA-256-OF-THE-CONTENT-IN-HEX      accepted, and what the implementation then parses
 *     no                                    refused
 *     split                                 accepted from a file or from memory only (Fast DDS reads files, Cyclone
 *                                           DDS memory)
 */
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <stdio.h>
#include <string.h>

static STACK_OF(X509) *read_authorities(const char *path)
{
    STACK_OF(X509) *authorities = sk_X509_new_null();
    BIO *file = BIO_new_file(path, "r");
    X509 *certificate;

    while (file != NULL && (certificate = PEM_read_bio_X509(file, NULL, NULL, NULL)) != NULL)
        sk_X509_push(authorities, certificate);
    BIO_free(file);
    ERR_clear_error();
    return authorities;
}

/* Write the hexadecimal digest of the accepted content to `answer`, or "no". */
static void verify(BIO *message, STACK_OF(X509) *authorities, char answer[2 * EVP_MAX_MD_SIZE + 1])
{
    BIO *content = NULL;
    BIO *accepted = BIO_new(BIO_s_mem());
    PKCS7 *signed_data = SMIME_read_PKCS7(message, &content);
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned int digest_length = 0;
    char *text = NULL;

    strcpy(answer, "no");
    if (signed_data != NULL
        && PKCS7_verify(signed_data, authorities, NULL, content, accepted,
                        PKCS7_TEXT | PKCS7_NOVERIFY | PKCS7_NOINTERN) == 1) {
        long length = BIO_get_mem_data(accepted, &text);
        EVP_Digest(text, (size_t)length, digest, &digest_length, EVP_sha256(), NULL);
        for (unsigned int i = 0; i < digest_length; i++)
            sprintf(answer + 2 * i, "%02x", digest[i]);
    }
    ERR_clear_error();
    PKCS7_free(signed_data);
    BIO_free(content);
    BIO_free(accepted);
}

int main(int argc, char **argv)
{
    char path[4096];
    STACK_OF(X509) *authorities;

    if (argc != 2)
        return 2;
    authorities = read_authorities(argv[1]);
    while (fgets(path, sizeof(path), stdin) != NULL) {
        char from_file[2 * EVP_MAX_MD_SIZE + 1] = "no", from_memory[2 * EVP_MAX_MD_SIZE + 1] = "no";
        static char bytes[8 << 20];
        FILE *stream;
        BIO *message;

        path[strcspn(path, "\n")] = '\0';
        message = BIO_new_file(path, "rb");
        if (message != NULL)
            verify(message, authorities, from_file);
        BIO_free(message);
        stream = fopen(path, "rb");
        if (stream != NULL) {
            message = BIO_new_mem_buf(bytes, (int)fread(bytes, 1, sizeof(bytes), stream));
            verify(message, authorities, from_memory);
            BIO_free(message);
            fclose(stream);
        }
        if (strcmp(from_file, from_memory) != 0)
            puts("split");
        else if (strcmp(from_file, "no") == 0)
            puts("no");
        else
            printf("ok %s\n", from_file);
        fflush(stdout);
    }
    return 0;
}
