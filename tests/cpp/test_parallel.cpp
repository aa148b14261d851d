#include <doctest/doctest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <vector>

#include "emseg/parallel.hpp"

using namespace emseg;

TEST_CASE("every task runs once, on a worker that exists") {
  for (const int threads : {1, 2, 7}) {
    CAPTURE(threads);
    ThreadPool pool(threads);
    REQUIRE(pool.worker_count() == threads);
    for (const std::size_t tasks : {0u, 1u, 2u, 3u, 100u, 5000u}) {
      std::vector<int> runs(tasks, 0);
      std::atomic<int> strangers{0};
      pool.for_each(tasks, [&](std::size_t task, int worker) {
        ++runs[task];
        if (worker < 0 || worker >= threads) ++strangers;
      });
      CHECK(runs == std::vector<int>(tasks, 1));
      CHECK(strangers == 0);
    }
  }
}

TEST_CASE("a worker is busy with one task at a time, so that it can own a workspace") {
  ThreadPool pool(7);
  std::vector<std::atomic<int>> busy(7);
  std::atomic<int> clashes{0};
  pool.for_each(2000, [&](std::size_t, int worker) {
    if (busy[static_cast<std::size_t>(worker)]++ != 0) ++clashes;
    --busy[static_cast<std::size_t>(worker)];
  });
  CHECK(clashes == 0);
}

TEST_CASE("what tasks wrote is seen by the caller, and the result is the same for any number of workers") {
  const auto squares = [](int threads) {
    ThreadPool pool(threads);
    std::vector<long> values(3000);
    for (int round = 0; round < 20; ++round) {
      pool.for_each(values.size(),
                    [&](std::size_t i, int) { values[i] += static_cast<long>(i * i) - values[i] / 2; });
    }
    return values;
  };
  const auto alone = squares(1);
  CHECK(squares(2) == alone);
  CHECK(squares(7) == alone);
}

TEST_CASE("the exception of the lowest task arrives, and the pool lives on") {
  for (const int threads : {1, 2, 7}) {
    CAPTURE(threads);
    ThreadPool pool(threads);
    for (int round = 0; round < 50; ++round) {
      std::string message;
      try {
        pool.for_each(40, [](std::size_t task, int) {
          if (task >= 17) throw std::runtime_error(std::to_string(task));
        });
      } catch (const std::runtime_error& error) {
        message = error.what();
      }
      REQUIRE(message == "17");
      std::atomic<int> runs{0};
      pool.for_each(8, [&](std::size_t, int) { ++runs; });
      REQUIRE(runs == 8);
    }
  }
}

TEST_CASE("no number of threads below none or beyond reason; none asked for takes the cores") {
  CHECK_THROWS_AS(ThreadPool(-1), std::invalid_argument);
  CHECK_THROWS_AS(ThreadPool(1025), std::invalid_argument);
  CHECK(ThreadPool(0).worker_count() >= 1);
}

TEST_CASE("tasks are put in order, the largest first, equal ones as they come") {
  CHECK(largest_first({}).empty());
  const std::vector<std::size_t> sizes{3, 0, 7, 3, 7, 1};
  CHECK(largest_first(sizes) == std::vector<std::size_t>{2, 4, 0, 3, 5, 1});
}
