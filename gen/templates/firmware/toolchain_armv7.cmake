# 32-bit ARM with hardware floating point under Linux (BeagleBone, Zynq). Debian, Ubuntu: apt install
# gcc-arm-linux-gnueabihf. Double precision needs a VFP unit for doubles: vfpv3-d16 or newer.
# For a board without an operating system, name its compiler and set CMAKE_SYSTEM_NAME to Generic.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR armv7-a)
set(CMAKE_C_COMPILER arm-linux-gnueabihf-gcc)
set(CMAKE_C_FLAGS_INIT "-march=armv7-a -mfpu=vfpv3-d16 -mfloat-abi=hard")
