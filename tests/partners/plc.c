/* A control made of libmodbus: its registers 0 to 13 hold 1000 + address, what is written to it is printed as ADDRESS=VALUE.
   Use: plc tcp PORT | plc rtu DEVICE */
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    int tcp = !strcmp(argv[1], "tcp"), listening = -1, length;
    modbus_t *line = tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2])) : modbus_new_rtu(argv[2], 19200, 'N', 8, 1);
    modbus_mapping_t *map = modbus_mapping_new(16, 16, 128, 128);
    unsigned char request[MODBUS_TCP_MAX_ADU_LENGTH];
    for (int at = 0; at < 14; at++) map->tab_registers[at] = 1000 + at;
    if (!tcp) modbus_set_slave(line, 1);
    if (tcp) listening = modbus_tcp_listen(line, 1);
    else if (modbus_connect(line)) return 1;
    puts("ready");
    fflush(stdout);
    for (;;) {
        if (tcp) modbus_tcp_accept(line, &listening);
        while ((length = modbus_receive(line, request)) >= 0) {
            if (!length) continue;
            unsigned short before = map->tab_registers[100];
            modbus_reply(line, request, length, map);
            if (map->tab_registers[100] != before) {
                printf("100=%d\n", map->tab_registers[100]);
                fflush(stdout);
            }
        }
    }
}
