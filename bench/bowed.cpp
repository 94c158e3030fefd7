// Times stk::Bowed::tick(): prints "ticks seconds rms" for each repeat.
//   g++ -O3 -march=native bowed.cpp -lstk -o bowed && ./bowed TICKS REPEATS
#include <stk/Bowed.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

int main(int argc, char **argv)
{
  const long ticks = argc > 1 ? std::atol(argv[1]) : 1000000;
  const int repeats = argc > 2 ? std::atoi(argv[2]) : 5;
  stk::Stk::setSampleRate(61160.0);  // the paper's: 139 samples a period at 440 Hz
  stk::Bowed string(100.0);
  string.setVibrato(0.0);
  string.noteOn(440.0, 0.8);
  for (int i = 0; i < 61160; ++i) string.tick();
  for (int repeat = 0; repeat < repeats; ++repeat) {
    double power = 0.0;
    const auto began = std::chrono::steady_clock::now();
    for (long i = 0; i < ticks; ++i) {
      const double sample = string.tick();
      power += sample * sample;
    }
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - began;
    std::printf("%ld %.9f %.6g\n", ticks, spent.count(), std::sqrt(power / ticks));
  }
}
