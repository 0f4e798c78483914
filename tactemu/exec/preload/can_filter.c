/* The filter of a CAN socket: a program for the kernel that selects frames, and that holds the options of the socket. */
#include "can.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <stdlib.h>

enum { MAGIC = 0x7ac7ca01 }; /* the last line of a program of ours */
enum { MAX_LINES = 32 + CAN_RAW_FILTER_MAX * 6 };

struct program {
    struct sock_filter lines[MAX_LINES];
    unsigned short count;
};

static void add(struct program *to, uint16_t code, uint8_t yes, uint8_t no, uint32_t value) {
    to->lines[to->count++] = (struct sock_filter){code, yes, no, value};
}

/* Add a filter of the kernel's layout. Identifiers have the byte order of the machine; the program loads big-endian ones.
 */
static void add_filter(struct program *to, const struct can_filter *filter, bool join) {
    uint32_t mask = filter->can_mask, inverse = filter->can_id & CAN_INV_FILTER;
    if (mask & CAN_EFF_FLAG && !(filter->can_id & CAN_EFF_FLAG)) mask &= CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    bool leave_if_equal = !inverse != join;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    add(to, BPF_ALU | BPF_AND | BPF_K, 0, 0, htonl(mask));
    add(to, BPF_JMP | BPF_JEQ | BPF_K, !leave_if_equal, leave_if_equal, htonl(filter->can_id & mask));
    add(to, BPF_RET | BPF_K, 0, 0, join ? 0 : UINT16_MAX);
}

static void compile(const struct options *wanted, struct program *to) {
    bool join = wanted->flags & JOIN, of_data = true;
    to->count = 0;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, SKF_AD_OFF + SKF_AD_PKTTYPE);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 1, 0, PACKET_OUTGOING);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, SKF_AD_OFF + SKF_AD_PROTOCOL);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 3, 0, TAG_LOCAL);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 2, 0, TAG_BUS);
    add(to, BPF_JMP | BPF_JSET | BPF_K, 1, 0, TAG_OWN);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_LEN, 0, 0, 0);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 2, 0, CAN_MTU);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, 1, 0, wanted->flags & FD ? CANFD_MTU : CAN_MTU);
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    add(to, BPF_JMP | BPF_JSET | BPF_K, 0, 1, htonl(CAN_ERR_FLAG));
    unsigned short errors = to->count;
    add(to, BPF_JMP | BPF_JA, 0, 0, 0);
    for (unsigned k = 0; k < wanted->count; k++) {
        bool error = wanted->filters[k].can_mask & CAN_ERR_FLAG;
        if (error) of_data = !join;
        else add_filter(to, &wanted->filters[k], join);
    }
    add(to, BPF_RET | BPF_K, 0, 0, join && wanted->count && of_data ? UINT16_MAX : 0);
    to->lines[errors].k = to->count - errors - 1;
    add(to, BPF_LD | BPF_W | BPF_ABS, 0, 0, 0);
    uint32_t accepted_errors = wanted->errors & CAN_ERR_MASK;
    for (unsigned k = 0; k < wanted->count; k++) {
        if (wanted->filters[k].can_mask & CAN_ERR_FLAG) accepted_errors |= wanted->filters[k].can_mask & CAN_ERR_MASK;
    }
    if (join && wanted->count > 1) accepted_errors = 0; /* no error matches all of several filters */
    add(to, BPF_JMP | BPF_JSET | BPF_K, 1, 0, htonl(accepted_errors));
    add(to, BPF_RET | BPF_K, 0, 0, 0);
    add(to, BPF_RET | BPF_K, 0, 0, UINT16_MAX);
    for (unsigned k = 0; k < wanted->count; k++) { /* these lines are data and never executed */
        add(to, BPF_LD | BPF_IMM, 0, 0, wanted->filters[k].can_id);
        add(to, BPF_LD | BPF_IMM, 0, 0, wanted->filters[k].can_mask);
    }
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->count);
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->errors);
    add(to, BPF_LD | BPF_IMM, 0, 0, wanted->flags);
    add(to, BPF_RET | BPF_K, 0, 0, MAGIC);
}

int can_write_options(int fd, const struct options *wanted, unsigned index) {
    struct program *program = malloc(sizeof *program);
    if (!program) return fail(ENOMEM);
    compile(wanted, program);
    struct sock_fprog filter = {program->count, program->lines};
    int state = OURS | (int)(wanted->flags << FLAGS | index);
    int result = REAL(setsockopt)(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter);
    if (!result) result = REAL(setsockopt)(fd, SOL_SOCKET, SO_RCVLOWAT, &state, sizeof state);
    free(program);
    return result;
}

int can_read_options(int fd, struct options *found) {
    struct program *program = malloc(sizeof *program);
    if (!program) return fail(ENOMEM);
    socklen_t count = MAX_LINES;
    int result = REAL(getsockopt)(fd, SOL_SOCKET, SO_GET_FILTER, program->lines, &count);
    if (!result && (count < 5 || program->lines[count - 1].k != MAGIC)) result = fail(EBADF);
    if (!result) {
        const struct sock_filter *last = &program->lines[count - 1];
        *found = (struct options){.flags = last[-1].k, .errors = last[-2].k, .count = last[-3].k};
        const struct sock_filter *first = last - 3 - 2 * found->count;
        for (unsigned k = 0; k < found->count; k++) {
            found->filters[k] = (struct can_filter){first[2 * k].k, first[2 * k + 1].k};
        }
    }
    free(program);
    return result;
}
