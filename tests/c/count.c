// Preloaded: counts what a program wants of the heap, of pthread's locks and of futexes; at the end it says how much. glibc only.

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);
extern int __pthread_mutex_lock(void *);

static atomic_long n_heap, n_locks;

#define COUNTED(counter, type, function, parameters, call) \
    type function parameters {                             \
        ++counter;                                         \
        return call;                                       \
    }

COUNTED(n_heap, void *, malloc, (size_t n), __libc_malloc(n))
COUNTED(n_heap, void *, calloc, (size_t n, size_t size), __libc_calloc(n, size))
COUNTED(n_heap, void *, realloc, (void *old, size_t n), __libc_realloc(old, n))
COUNTED(n_heap, void *, aligned_alloc, (size_t to, size_t n), __libc_memalign(to, n))
COUNTED(n_heap, int, posix_memalign, (void **out, size_t to, size_t n), (*out = __libc_memalign(to, n)) ? 0 : 12)
COUNTED(n_heap, void, free, (void *old), __libc_free(old))
COUNTED(n_locks, int, pthread_mutex_lock, (void *mutex), __pthread_mutex_lock(mutex))
COUNTED(n_locks, long, syscall, (long number), -number) // futexes of the Rust library; no other call is made by number

__attribute__((destructor)) static void print(void) { fprintf(stderr, "heap %ld locks %ld\n", n_heap, n_locks); }
