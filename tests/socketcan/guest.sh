#!/bin/sh
# First process of a user-mode Linux on the host's files: real SocketCAN, an emulator and a host on vcan0.
# Wants FOLDER, PYTHON, REPOSITORY, PACES, SECONDS_OF_RUN, BUS_OFF_AFTER in its environment.
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t tmpfs -o size=200m tmpfs /run
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    insmod "$modules/$module.ko" || echo "cannot load $module"
done
ip link set up lo
ip link add dev vcan0 type vcan && ip link set up vcan0
cd "$REPOSITORY" || halt -f
export PYTHONPATH="$REPOSITORY" PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 HOME=/root
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
bench="$PYTHON -m sysid_bench"
exec </dev/null

# what is wrong with a bus is said at once: no such interface, an interface that is down
$bench measure bus=socketcan bus.channel=can7 out="$FOLDER/none.mcap" 2>"$FOLDER/no_interface.err"
echo $? >"$FOLDER/no_interface.rc"
ip link add dev vcan1 type vcan
$bench measure bus=socketcan bus.channel=vcan1 out="$FOLDER/none.mcap" 2>"$FOLDER/down.err"
echo $? >"$FOLDER/down.rc"

# logs go to memory first: the guest stands still while the host's disk is written
# A busy machine cannot keep 500 Hz in the guest: device time then runs slower than real time, as slow as it takes.
for pace in $PACES; do
    candump -L -r 16777216 vcan0 >/run/candump.log &
    witness=$!
    $bench emulate bus=socketcan pace="$pace" truth=/run/truth.csv >"$FOLDER/emulate.out" 2>&1 &
    device=$!
    while ! grep -q emulating "$FOLDER/emulate.out"; do sleep 0.2; done
    $bench measure bus=socketcan pace="$pace" seconds="$SECONDS_OF_RUN" out=/run/run.mcap >"$FOLDER/measure.out" 2>&1
    code=$?
    kill $witness; wait $witness
    [ $code = 0 ] && break
    kill $device; wait $device
done
echo $code >"$FOLDER/measure.rc"
# a bus-off, as a controller reports it, ends a run
( while [ ! -s /run/bus_off.mcap ]; do sleep 0.5; done; sleep "$BUS_OFF_AFTER"; cansend vcan0 20000040#0000000000000000 ) &
$bench measure bus=socketcan pace="$pace" seconds=60 out=/run/bus_off.mcap >"$FOLDER/bus_off.out" 2>&1
echo $? >"$FOLDER/bus_off.rc"
kill $device; wait $device
cp /run/candump.log /run/truth.csv /run/run.mcap /run/bus_off.mcap "$FOLDER"
sync
halt -f
