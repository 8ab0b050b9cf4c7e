# 64-bit ARM under Linux (Raspberry Pi 4 and 5, Jetson). Debian, Ubuntu: apt install gcc-aarch64-linux-gnu.
# For a board without an operating system, name its compiler and set CMAKE_SYSTEM_NAME to Generic.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
