/* Firmware that takes samples for a host: bytes over the serial port of QEMU's boards mps2-an386 and mps2-an500.
 * `Component` becomes the name of the component.
 *
 * 'i': init. 'p', parameter, element, value: set a parameter. 's', inputs: a step. Each answers with its status, a
 * step also with 25 MHz ticks, stack in bytes and outputs. */
#include <stdint.h>
#include <string.h>

#include "Component.h"

#define UART ((volatile uint32_t *)0x40004000u)
#define TIMER ((volatile uint32_t *)0x40000000u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define PAINT 0xA5A5A5A5u

extern uint32_t stack_bottom[], stack_top[], bss_start[], bss_end[];
static Component self;
static Component_inputs inputs;
static Component_outputs outputs;

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

static void receive(void *to, unsigned n) {
    for (unsigned i = 0; i < n; i++) {
        while (!(UART[1] & 2u)) {}
        ((unsigned char *)to)[i] = (unsigned char)UART[0];
    }
}

static void send(const void *from, unsigned n) {
    for (unsigned i = 0; i < n; i++) {
        while (UART[1] & 1u) {}
        UART[0] = ((const unsigned char *)from)[i];
    }
}

int main(void) {
    UART[4] = 16;
    UART[2] = 3;
    TIMER[2] = 0xFFFFFFFFu;
    TIMER[1] = 0xFFFFFFFFu;
    TIMER[0] = 1;
    volatile uint32_t *here; /* below it is free, but for what is called from here */
    __asm volatile("mov %0, sp" : "=r"(here));
    for (volatile uint32_t *p = stack_bottom; p < here; p++) *p = PAINT;
    Component_init(&self);
    for (;;) {
        unsigned char command = 0;
        int32_t status = 0;
        receive(&command, 1);
        if (command == 'i') Component_init(&self);
        if (command == 'p') {
            int32_t which[2];
            double value;
            receive(which, sizeof which);
            receive(&value, sizeof value);
            status = (int32_t)Component_set_parameter(&self, (Component_parameter)which[0], which[1], value);
        }
        if (command == 's') {
            uint32_t report[2];
            receive(&inputs, sizeof inputs);
            const uint32_t begin = TIMER[1];
            status = (int32_t)Component_step(&self, &inputs, &outputs);
            report[0] = begin - TIMER[1];
            const uint32_t *p = stack_bottom;
            while (*p == PAINT) p++;
            report[1] = (uint32_t)((const volatile char *)here - (const volatile char *)p);
            send(&status, sizeof status);
            send(report, sizeof report);
            send(&outputs, sizeof outputs);
        } else send(&status, sizeof status);
    }
}
