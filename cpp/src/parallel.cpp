#include "emseg/parallel.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <system_error>

namespace emseg {

std::vector<std::size_t> largest_first(std::span<const std::size_t> sizes) {
  std::vector<std::size_t> order(sizes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return sizes[a] > sizes[b]; });
  return order;
}

ThreadPool::ThreadPool(int threads) : worker_count_(threads) {
  if (threads < 0 || threads > 1024) {
    throw std::invalid_argument("threads is " + std::to_string(threads) + ", expected 0 (all cores) to 1024");
  }
  if (threads == 0) worker_count_ = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

// Where the system has no more threads to give, those that it gave do the work.
void ThreadPool::start() {
  try {
    for (int worker = static_cast<int>(threads_.size()) + 1; worker < worker_count_; ++worker) {
      threads_.emplace_back([this, worker] { work(worker); });
    }
  } catch (const std::system_error&) {
  }
}

ThreadPool::~ThreadPool() { stop(); }

void ThreadPool::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ThreadPool::for_each(std::size_t task_count, const std::function<void(std::size_t, int)>& body) {
  if (worker_count_ == 1 || task_count < 2) {
    for (std::size_t task = 0; task < task_count; ++task) body(task, 0);
    return;
  }
  start();
  std::unique_lock lock(mutex_);
  body_ = &body;
  next_task_ = 0;
  task_count_ = task_count;
  failure_ = nullptr;
  wake_.notify_all();
  run_tasks(lock, 0);
  done_.wait(lock, [this] { return running_ == 0 && next_task_ >= task_count_; });
  body_ = nullptr;
  if (failure_) std::rethrow_exception(failure_);
}

void ThreadPool::work(int worker) {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || (body_ && next_task_ < task_count_); });
    if (stopping_) return;
    run_tasks(lock, worker);
  }
}

void ThreadPool::run_tasks(std::unique_lock<std::mutex>& lock, int worker) {
  while (body_ && next_task_ < task_count_) {
    const std::size_t task = next_task_++;
    const auto* body = body_;
    ++running_;
    lock.unlock();
    std::exception_ptr failure;
    try {
      (*body)(task, worker);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    --running_;
    if (failure && (!failure_ || task < failed_task_)) {
      failure_ = failure;
      failed_task_ = task;
    }
  }
  if (running_ == 0 && next_task_ >= task_count_) done_.notify_all();
}

}  // namespace emseg
