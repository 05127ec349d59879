/* Firmware that takes samples for a host, on QEMU's boards mps2-an386 and mps2-an500. Requests come from the emulator's
 * standard input by semihosting, in blocks; its serial port would take a pass of QEMU's event loop for each byte.
 * `Component` becomes the name of the component, FRAME the most samples of a request.
 *
 * 'i': init. 'p', parameter, element, value: set a parameter. 's', number, inputs: steps until one fails. 'g': the
 * instance. 'r', instance: restore it. Each answers with its status; 's' also with the number of samples taken, the
 * largest stack so far in bytes, and for each sample 25 MHz ticks and outputs. */
#include <stdint.h>
#include <string.h>

#include "Component.h"

#define TIMER ((volatile uint32_t *)0x40000000u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define PAINT 0xA5A5A5A5u

extern uint32_t stack_bottom[], stack_top[], bss_start[], bss_end[];
static Component self;
static Component_inputs inputs[FRAME];
static struct {
    double ticks;
    Component_outputs outputs;
} answers[FRAME];
static uint32_t requests, replies; /* handles */

int main(void);

static void reset(void) {
    CPACR |= 0xFu << 20; /* the floating-point unit */
    __asm volatile("dsb\n isb");
    for (uint32_t *p = bss_start; p < bss_end; p++) *p = 0;
    (void)main();
}

static void stop(void) {
    for (;;) {}
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    stack_top, (const void *)reset, (const void *)stop, (const void *)stop, (const void *)stop, (const void *)stop,
    (const void *)stop};

enum { SYS_OPEN = 1, SYS_WRITE = 5, SYS_READ = 6, SYS_EXIT = 0x18, READ_BINARY = 1, WRITE_BINARY = 5 };

/* A call of the host (Semihosting for AArch32 and AArch64, section "The semihosting interface"). */
static uint32_t call_host(uint32_t operation, const void *arguments) {
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t open_console(uint32_t mode) {
    const struct {
        const char *name;
        uint32_t mode, length;
    } arguments = {":tt", mode, 3};
    return call_host(SYS_OPEN, &arguments);
}

/* Ends the emulator when the host has closed the other end. */
static void transfer(uint32_t operation, uint32_t handle, void *data, uint32_t n) {
    struct {
        uint32_t handle;
        char *data;
        uint32_t left;
    } arguments = {handle, data, n};
    while (arguments.left > 0) {
        const uint32_t left = call_host(operation, &arguments);
        if (left >= arguments.left) (void)call_host(SYS_EXIT, (const void *)0x20026u); /* ADP_Stopped_ApplicationExit */
        arguments.data += arguments.left - left;
        arguments.left = left;
    }
}

static void receive(void *to, uint32_t n) { transfer(SYS_READ, requests, to, n); }

static void send(void *from, uint32_t n) { transfer(SYS_WRITE, replies, from, n); }

static int32_t take_samples(uint32_t n, uint32_t *taken) {
    int32_t status = 0;
    for (*taken = 0; *taken < n && status == 0; *taken += status == 0) {
        const uint32_t begin = TIMER[1];
        status = (int32_t)Component_step(&self, &inputs[*taken], &answers[*taken].outputs);
        answers[*taken].ticks = begin - TIMER[1];
    }
    return status;
}

int main(void) {
    TIMER[2] = 0xFFFFFFFFu;
    TIMER[1] = 0xFFFFFFFFu;
    TIMER[0] = 1;
    requests = open_console(READ_BINARY);
    replies = open_console(WRITE_BINARY);
    volatile uint32_t *here; /* below it is free, but for what is called from here */
    __asm volatile("mov %0, sp" : "=r"(here));
    for (volatile uint32_t *p = stack_bottom; p < here; p++) *p = PAINT;
    Component_init(&self);
    for (;;) {
        unsigned char command = 0;
        uint32_t n, report[3] = {0};
        receive(&command, 1);
        if (command == 'i') Component_init(&self);
        if (command == 'p') {
            struct {
                uint32_t parameter, element;
                double value;
            } change;
            receive(&change, sizeof change);
            report[0] = (uint32_t)Component_set_parameter(
                &self, (Component_parameter)change.parameter, (int)change.element, change.value);
        }
        if (command == 'r') receive(&self, sizeof self);
        if (command == 's') {
            receive(&n, sizeof n);
            receive(inputs, n * sizeof inputs[0]);
            report[0] = (uint32_t)take_samples(n, &report[1]);
            const uint32_t *p = stack_bottom;
            while (*p == PAINT) p++;
            report[2] = (uint32_t)((const volatile char *)here - (const volatile char *)p);
            send(report, sizeof report);
            send(answers, n * sizeof answers[0]);
        } else send(report, sizeof report[0]);
        if (command == 'g') send(&self, sizeof self);
    }
}
