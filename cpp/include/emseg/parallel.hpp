// The one place with threads: independent tasks handed to a fixed team of workers.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

namespace emseg {

// Tasks of these sizes, the largest first: begun in this order, none is left for a single worker in the end.
std::vector<std::size_t> largest_first(std::span<const std::size_t> sizes);

// Runs tasks 0..n-1, each exactly once.  Results do not depend on the number of workers as long as each task
// writes only what belongs to it: tasks are fixed by the caller, and merging them in order is the caller's
// part.
class ThreadPool {
 public:
  // `threads` workers, the calling thread included; 0 takes one per core.  They start when they first have
  // work.
  explicit ThreadPool(int threads = 0);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int worker_count() const { return worker_count_; }

  // body(task, worker), worker in 0..worker_count()-1 to pick a workspace.  Rethrows the exception of the
  // lowest task that threw.  Not to be called from within a task.
  void for_each(std::size_t task_count, const std::function<void(std::size_t, int)>& body);

 private:
  void start();
  void stop();
  void work(int worker);
  void run_tasks(std::unique_lock<std::mutex>& lock, int worker);

  int worker_count_;
  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable done_;
  const std::function<void(std::size_t, int)>* body_ = nullptr;
  std::size_t next_task_ = 0;
  std::size_t task_count_ = 0;
  std::size_t running_ = 0;
  std::size_t failed_task_ = 0;
  std::exception_ptr failure_;
  bool stopping_ = false;
};

}  // namespace emseg
